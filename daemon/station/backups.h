// The nightly backup, in a thread of its own: BACKUPS/lampglow-20261122.db, checked, the oldest dropped.
#pragma once

#include <filesystem>
#include <functional>
#include <stop_token>
#include <string>
#include <thread>

#include "estimator/time.h"
#include "storage/error.h"
#include "storage/file_id.h"

namespace lampglow::daemon {

class Backups {
 public:
  enum class Result { good, failed, damaged };  // damaged: the database itself, which then does not go on
  // Is told of each backup in words, from the backup's thread.
  // `file`: that was damaged.
  using Done = std::function<void(Result result, const std::string& message, const storage::FileId& file)>;
  Backups(std::filesystem::path database, std::filesystem::path folder, int keep, int hour_utc, Done done);

  // Starts a backup if the hour has come and today's is not there yet.
  void tick(TimePoint utc);
  void set(int keep, int hour_utc);
  // From any thread: breaks off a backup that is being made, within a moment, and lets no other begin.
  // Nothing of it is left, and nothing is told.
  void request_stop() { stop_.request_stop(); }
  void stop();  // and waits for its end

 private:
  void make(const std::filesystem::path& copy, int keep) const;
  void say_why(const storage::StorageError& error) const;
  void remove_leftovers() const;
  void drop_oldest(int keep) const;

  std::filesystem::path database_, folder_;
  int keep_, hour_utc_;
  Done done_;
  std::string last_day_;
  std::stop_source stop_;
  std::jthread thread_;
};

}  // namespace lampglow::daemon
