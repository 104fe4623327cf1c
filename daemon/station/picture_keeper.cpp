#include "daemon/station/picture_keeper.h"

#include <charconv>
#include <set>
#include <utility>

#include "daemon/config/files.h"
#include "daemon/errors.h"
#include "daemon/station/log.h"

namespace lampglow::daemon {
namespace {

constexpr std::chrono::hours kLongestGap{1};

std::int64_t hour_of(TimePoint time) {
  return std::chrono::floor<std::chrono::hours>(time).time_since_epoch().count();
}

}  // namespace

FogWatch::Change FogWatch::note(const Observation& observation) {
  const auto mor_m = observation.mor_m();
  if (!mor_m) return Change::none;
  if (observation.time_utc - std::exchange(latest_, observation.time_utc) > kLongestGap) in_fog_ = false;
  if (!in_fog_ && *mor_m < 1000 && observation.limit != Limit::above) {
    in_fog_ = true;
    return Change::began;
  }
  if (in_fog_ && *mor_m > 1200 && observation.limit != Limit::below) {
    in_fog_ = false;
    return Change::ended;
  }
  return Change::none;
}

std::filesystem::path PictureKeeper::file_of(const storage::PictureRecord& picture) const {
  return folder_ / picture.camera / (std::to_string(picture.time_utc.time_since_epoch().count()) + ".jpg");
}

void PictureKeeper::load(const std::vector<storage::PictureRecord>& kept) {
  for (const storage::PictureRecord& picture : kept) {
    kept_.emplace(picture.time_utc, picture);
    bytes_ += picture.size_bytes;
    last_hour_[picture.camera] = hour_of(picture.time_utc);
  }
  adopt_files();
}

void PictureKeeper::adopt_files() {
  std::set<std::filesystem::path> known;
  for (const auto& [time, picture] : kept_) known.insert(file_of(picture));
  std::error_code none_yet;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_, none_yet)) {
    const std::filesystem::path& file = entry.path();
    const std::string name = file.stem().string();
    std::int64_t time_ms = 0;
    const auto [end, wrong] = std::from_chars(name.data(), name.data() + name.size(), time_ms);
    if (!entry.is_regular_file() || file.extension() != ".jpg" || wrong != std::errc{} ||
        end != name.data() + name.size() || known.contains(file))
      continue;
    const TimePoint time{std::chrono::milliseconds{time_ms}};
    const auto bytes = static_cast<std::int64_t>(entry.file_size());
    kept_.emplace(time, storage::PictureRecord{file.parent_path().filename().string(), time,
                                               storage::KeptFor::hourly, bytes});
    bytes_ += bytes;
  }
}

void PictureKeeper::offer(const std::string& camera, TimePoint time, bool fog_began, const std::string& jpeg,
                          Keeper& keeper) {
  const auto last = last_hour_.find(camera);
  const bool hourly = options_.hourly && (last == last_hour_.end() || last->second != hour_of(time));
  if (!hourly && !(fog_began && options_.fog_onset)) return;
  const storage::PictureRecord picture{
      camera, time, fog_began ? storage::KeptFor::fog_onset : storage::KeptFor::hourly, std::ssize(jpeg)};
  if (picture.size_bytes > options_.max_bytes) return;
  try {
    std::filesystem::create_directories(folder_ / camera);
    write_file_atomically(file_of(picture), jpeg);
  } catch (const std::exception& error) {
    log(LogLevel::warning, "a picture could not be kept", {{"camera", camera}, {"reason", error.what()}});
    return;
  }
  last_hour_[camera] = hour_of(time);
  keeper.put_picture(camera, picture);
  kept_.emplace(time, picture);
  bytes_ += picture.size_bytes;
  while (bytes_ > options_.max_bytes && !kept_.empty()) drop_oldest(keeper);
}

void PictureKeeper::drop_oldest(Keeper& keeper) {
  const storage::PictureRecord picture = kept_.begin()->second;
  kept_.erase(kept_.begin());
  bytes_ -= picture.size_bytes;
  std::error_code ignored;
  std::filesystem::remove(file_of(picture), ignored);
  keeper.erase_picture(picture);
}

}  // namespace lampglow::daemon
