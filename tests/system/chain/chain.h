// The whole chain of a live camera: a simulated night, shown to a running station by any source, and its
// numbers out of the database against those of a replay of the archive itself.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "storage/records.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {

// Writes a night of two clear references and `frames` observations of well separated visibility: FOLDER/jpeg
// as the program makes it (8-bit sRGB JPEG, exposure not told) and FOLDER/png, the same pictures without loss
// (grey PNG). The site has no place, so that any hour of the test's day is night.
void make_night(const fs::path& folder, int frames = 4);

struct Night {
  fs::path archive;                            // FOLDER/jpeg or FOLDER/png
  std::vector<fs::path> pictures;              // of the observations, oldest first
  std::vector<storage::ObservationRow> truth;  // what a replay stores of them
};

// Replays the archive with the program; `database` is written.
Night replay_night(const fs::path& archive, const fs::path& database);

// The observations of a database, oldest first; none if it can't be read yet.
std::vector<storage::ObservationRow> stored_in(const fs::path& database);

// Which number differs, as text; empty if all are the same to the last bit. Times differ, and so may the
// flags that tell of the live camera and its clock: camera_not_locked, clock_unsynchronised.
std::string difference(const Observation& live, const Observation& archived);

// |ln| of the ratio of the extinctions. Both must have one.
double log_ratio(const Observation& live, const Observation& archived);

// A station with one camera, "chain", on a schedule of 1 s unless told otherwise.
class ChainStation {
 public:
  // `source`: the lines of the [source] table.
  ChainStation(const fs::path& folder, const fs::path& reference_archive, const std::string& source,
               int interval_s = 1);
  // Another interval, taken over by a reload: returns when the station has said so.
  void reload_with(int interval_s) const;
  fs::path database() const { return folder_ / "data/lampglow.db"; }
  std::vector<storage::ObservationRow> stored() const { return stored_in(database()); }
  std::string log() const { return serving_->log(); }
  int port() const { return port_; }
  const Serving& serving() const { return *serving_; }

  // Until a stored observation is bit for bit that of the archive; false, after 30 s, with a failed check
  // that tells what was stored instead.
  bool stores(const Observation& archived, std::chrono::seconds limit = std::chrono::seconds(30)) const;

 private:
  void configure(int interval_s) const;

  fs::path folder_, reference_archive_;
  std::string source_;
  int port_ = free_port();
  std::unique_ptr<Serving> serving_;
};

}  // namespace lampglow::testing
