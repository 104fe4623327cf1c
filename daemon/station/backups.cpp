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
  if (std::filesystem::exists(copy)) return;
  thread_ = std::jthread([this, copy, keep = keep_](const std::stop_token& stop) {
    make(copy, keep, stop);
  });  // the last one has long ended
}

void Backups::stop() {
  thread_ = {};
}

void Backups::make(const std::filesystem::path& copy, int keep, const std::stop_token& stop) const {
  try {
    std::filesystem::create_directories(folder_);
    if (!storage::backup(database_, copy, stop)) return;
    std::vector<std::filesystem::path> all;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) {
      const std::string name = entry.path().filename().string();
      if (name.starts_with("lampglow-") && name.ends_with(".db")) all.push_back(entry.path());
    }
    std::sort(all.begin(), all.end());
    for (std::size_t i = 0; i + static_cast<std::size_t>(keep) < all.size(); ++i)
      std::filesystem::remove(all[i]);
    done_(true, "backup " + copy.filename().string() + " made and checked");
  } catch (const std::exception& error) {
    done_(false, std::string("the backup failed: ") + error.what());
  }
}

}  // namespace lampglow::daemon
