// Short, read-only questions to a database that a Store may be writing. One reader per thread.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "storage/error.h"
#include "storage/records.h"

namespace lampglow::storage {

// Rows of one camera with from <= time < to, ascending, at most `limit`: the oldest, or the newest. Keyset
// paging through the former: ask again with `after` = the last row's time.
struct ObservationQuery {
  CameraNumber camera = 0;
  TimePoint from{};
  TimePoint to{};
  int period_s = 0;  // 0 single frames, or 60, 600, 3600
  std::optional<TimePoint> after;
  int limit = 1000;
  bool newest = false;
};

struct LampFitRow {
  LampFit fit;  // without ring profile
  TimePoint time_utc{};
};

class Reader {
 public:
  // Throws StorageError; a file that is not there is `io`.
  explicit Reader(const std::filesystem::path& file, int busy_timeout_ms = 2000);
  ~Reader();
  Reader(Reader&&) noexcept;
  Reader& operator=(Reader&&) noexcept;

  std::vector<CameraRecord> cameras();
  std::optional<CameraRecord> camera(const std::string& name);

  std::vector<ObservationRow> observations(const ObservationQuery& query);
  std::optional<ObservationRow> latest(CameraNumber camera, int period_s = 0);
  // The time of the camera's first and last frame.
  std::optional<std::pair<TimePoint, TimePoint>> span(CameraNumber camera);

  // The newest hour of a stretch of a day at least, within which no week is without frames: what a clock that
  // was wrong for some hours has put behind it does not count. The first stretch's, if none is that long;
  // empty if nothing is stored.
  std::optional<TimePoint> newest_of_a_day(CameraNumber camera);

  // The catalogue in force, by id.
  std::vector<LampRecord> lamps(CameraNumber camera);
  // Fits of the frame at that time; of the latest frame that has any, without a time.
  std::vector<LampFitRow> fits(CameraNumber camera, std::optional<TimePoint> time = {});
  // The rings of a lamp at that time, or the latest kept; empty vectors if there are none.
  std::optional<std::pair<TimePoint, RingProfile>> rings(CameraNumber camera, const std::string& lamp,
                                                         std::optional<TimePoint> time = {});

  // Events with number > after, ascending, at most `limit`; of [from, to) where given.
  std::vector<Event> events(std::int64_t after, int limit, std::optional<TimePoint> from = {},
                            std::optional<TimePoint> to = {});
  // The last `limit` events, ascending.
  std::vector<Event> last_events(int limit);

  // Ascending; `limit` of them, and those of the last one's time from other cameras, too.
  std::vector<PictureRecord> pictures(const std::optional<std::string>& camera, TimePoint from, TimePoint to,
                                      int limit);
  std::int64_t picture_bytes();  // of all kept pictures

  // All of a database's content tables as text, row by row in the order of keys: to compare two databases.
  std::string content();

  // What PRAGMA quick_check (or integrity_check) says; "ok" for a sound database.
  std::string check(bool full);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::storage
