// The nightly backup, in a thread of its own: BACKUPS/lampglow-20261122.db, checked, the oldest dropped.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <thread>

#include "estimator/time.h"

namespace lampglow::daemon {

class Backups {
 public:
  // `done` is told of each backup in words, from the backup's thread.
  using Done = std::function<void(bool good, const std::string& message)>;
  Backups(std::filesystem::path database, std::filesystem::path folder, int keep, int hour_utc, Done done);

  // Starts a backup if the hour has come and today's is not there yet.
  void tick(TimePoint utc);
  void set(int keep, int hour_utc);
  // Breaks off a backup that is being made, within a moment; nothing of it is left, and nothing is told.
  void stop();

 private:
  void make(const std::filesystem::path& copy, int keep, const std::stop_token& stop) const;

  std::filesystem::path database_, folder_;
  int keep_, hour_utc_;
  Done done_;
  std::string last_day_;
  std::jthread thread_;
};

}  // namespace lampglow::daemon
