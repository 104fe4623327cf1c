#include "daemon/station/backups.h"

#include <algorithm>
#include <vector>

#include "storage/maintenance.h"

namespace lampglow::daemon {

Backups::Backups(std::filesystem::path database, std::filesystem::path folder, int keep, int hour_utc,
                 Done done)
    : database_(std::move(database)),
      folder_(std::move(folder)),
      keep_(keep),
      hour_utc_(hour_utc),
      done_(std::move(done)) {}

void Backups::set(int keep, int hour_utc) {
  keep_ = keep;
  hour_utc_ = hour_utc;
}

void Backups::tick(TimePoint utc) {
  const auto day = std::chrono::floor<std::chrono::days>(utc);
  const auto hour = std::chrono::floor<std::chrono::hours>(utc - day).count();
  if (hour_utc_ < 0 || hour != hour_utc_) return;
  std::string name = format_time_utc(day).substr(0, 10);
  if (name == last_day_) return;
  last_day_ = name;
  name.erase(std::remove(name.begin(), name.end(), '-'), name.end());
  const std::filesystem::path copy = folder_ / ("lampglow-" + name + ".db");
  std::error_code unknown;
  if (std::filesystem::exists(copy, unknown) || stop_.stop_requested()) return;
  thread_ = std::jthread([this, copy, keep = keep_] { make(copy, keep); });  // the last one has long ended
}

void Backups::stop() {
  request_stop();
  thread_ = {};
}

void Backups::make(const std::filesystem::path& copy, int keep) const {
  try {
    std::filesystem::create_directories(folder_);
    remove_leftovers();
    if (!storage::backup(database_, copy, stop_.get_token())) return;
    drop_oldest(keep);
    done_(Result::good, "backup " + copy.filename().string() + " made and checked", {});
  } catch (const storage::StorageError& error) {
    say_why(error);
  } catch (const std::exception& error) {
    done_(Result::failed, std::string("the backup failed: ") + error.what(), {});
  }
}

// A copy that is damaged may be the database's fault or its own disk's.
void Backups::say_why(const storage::StorageError& error) const {
  const std::string failed = std::string("the backup failed: ") + error.what();
  if (error.kind() != storage::StorageError::Kind::corrupt) return done_(Result::failed, failed, {});
  const storage::FileId file = storage::file_id(database_).value_or(storage::FileId{});
  try {
    const std::string found = storage::check(database_, true, stop_.get_token());
    done_(found == "ok" ? Result::failed : Result::damaged, found == "ok" ? failed : found, file);
  } catch (const storage::StorageError& why) {
    using Kind = storage::StorageError::Kind;
    if (why.kind() == Kind::stopped) return;
    done_(why.kind() == Kind::corrupt ? Result::damaged : Result::failed, why.what(), file);
  }
}

// Of a backup that a power cut ended.
void Backups::remove_leftovers() const {
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("lampglow-") && name.find(".db.part") != std::string::npos)
      std::filesystem::remove(entry.path());
  }
}

void Backups::drop_oldest(int keep) const {
  std::vector<std::filesystem::path> all;
  for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("lampglow-") && name.ends_with(".db")) all.push_back(entry.path());
  }
  std::sort(all.begin(), all.end());
  for (std::size_t i = 0; i + static_cast<std::size_t>(keep) < all.size(); ++i)
    std::filesystem::remove(all[i]);
}

}  // namespace lampglow::daemon
