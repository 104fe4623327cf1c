// Which pictures are kept as files beside the database: one an hour and every onset of fog, in a bounded
// space. Where it does not hold all, the oldest hourly ones go first: onsets are few, and what people look
// for years later. Only what onsets take above half of the space goes before an hourly one.
#pragma once

#include <functional>
#include <map>
#include <string>

#include "daemon/station/config.h"
#include "daemon/station/keeper.h"
#include "storage/records.h"

namespace lampglow::daemon {

// MOR below 1000 m begins fog, above 1200 m ends it. Nobody knows of a fog that nothing was seen of for an
// hour whether it is the same: what is seen then is an onset.
class FogWatch {
 public:
  enum class Change { none, began, ended };
  Change note(const Observation& observation);

 private:
  bool in_fog_ = false;
  TimePoint latest_{};  // with a value
};

class PictureKeeper {
 public:
  PictureKeeper(std::filesystem::path folder, PictureOptions options)
      : folder_(std::move(folder)), options_(options) {}

  // What earlier runs kept, oldest first, from the database; and the files of a database that was set aside
  // or deleted, so that they count and go in their turn, too.
  void load(const std::vector<storage::PictureRecord>& kept);
  void set_options(const PictureOptions& options) { options_ = options; }

  // Keeps the picture if it is worth it, and drops others if there are too many bytes. A disk that is full is
  // a warning in the log, no more.
  void offer(const std::string& camera, TimePoint time, bool fog_began, const std::string& jpeg,
             Keeper& keeper);

 private:
  // The kept pictures of one kind, oldest first.
  struct Shelf {
    std::multimap<TimePoint, storage::PictureRecord> pictures;
    std::int64_t bytes = 0;
  };

  void adopt_files();
  void put_on_shelf(const storage::PictureRecord& picture);
  void drop_one(Keeper& keeper);
  Shelf& shelf_of(storage::KeptFor kind) { return kind == storage::KeptFor::fog_onset ? onsets_ : hourly_; }
  std::int64_t bytes() const { return hourly_.bytes + onsets_.bytes; }
  std::filesystem::path file_of(const storage::PictureRecord& picture) const;

  std::filesystem::path folder_;
  PictureOptions options_;
  Shelf hourly_, onsets_;
  std::map<std::string, std::int64_t> last_hour_;
};

}  // namespace lampglow::daemon
