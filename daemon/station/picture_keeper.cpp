#include "daemon/station/picture_keeper.h"

#include <charconv>
#include <optional>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "daemon/config/files.h"
#include "daemon/errors.h"
#include "daemon/station/log.h"

namespace lampglow::daemon {
namespace {

constexpr std::chrono::hours kLongestGap{1};

std::int64_t hour_of(TimePoint time) {
  return std::chrono::floor<std::chrono::hours>(time).time_since_epoch().count();
}

struct NamedPicture {
  TimePoint time_utc;
  bool half = false;  // TIME.jpg.XXXXXX: the station was killed while it wrote it
};

// Empty: it has no picture's name.
std::optional<NamedPicture> picture_of(const std::filesystem::path& file) {
  constexpr std::string_view kEnd = ".jpg";
  constexpr std::size_t kHalfEnd = 7;  // of PendingFile
  const std::string name = file.filename().string();
  std::int64_t time_ms = 0;
  const auto [end, wrong] = std::from_chars(name.data(), name.data() + name.size(), time_ms);
  if (wrong != std::errc{}) return std::nullopt;
  const std::string_view rest = std::string_view(name).substr(static_cast<std::size_t>(end - name.data()));
  const bool half = rest.size() == kEnd.size() + kHalfEnd && rest[kEnd.size()] == '.';
  if (!rest.starts_with(kEnd) || (rest != kEnd && !half)) return std::nullopt;
  return NamedPicture{TimePoint{std::chrono::milliseconds{time_ms}}, half};
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
    put_on_shelf(picture);
    last_hour_[picture.camera] = hour_of(picture.time_utc);
  }
  adopt_files();
}

// What cannot be looked into (a disk's own lost+found) is not ours.
void PictureKeeper::adopt_files() {
  using Walk = std::filesystem::recursive_directory_iterator;
  std::set<std::filesystem::path> known;
  for (const Shelf* shelf : {&hourly_, &onsets_})
    for (const auto& [time, picture] : shelf->pictures) known.insert(file_of(picture));
  std::error_code error;
  std::vector<std::filesystem::path> halves;
  for (Walk walk(folder_, std::filesystem::directory_options::skip_permission_denied, error);
       !error && walk != Walk(); walk.increment(error)) {
    const std::filesystem::path& file = walk->path();
    const std::optional<NamedPicture> picture = picture_of(file);
    std::error_code unknown;
    if (!picture || !walk->is_regular_file(unknown) || known.contains(file)) continue;
    const auto bytes = static_cast<std::int64_t>(walk->file_size(unknown));
    if (picture->half)
      halves.push_back(file);
    else if (!unknown)
      put_on_shelf(
          {file.parent_path().filename().string(), picture->time_utc, storage::KeptFor::hourly, bytes});
  }
  for (const std::filesystem::path& file : halves) std::filesystem::remove(file, error);
}

void PictureKeeper::put_on_shelf(const storage::PictureRecord& picture) {
  Shelf& shelf = shelf_of(picture.kept_for);
  shelf.pictures.emplace(picture.time_utc, picture);
  shelf.bytes += picture.size_bytes;
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
  put_on_shelf(picture);
  while (bytes() > options_.max_bytes) drop_one(keeper);
}

void PictureKeeper::drop_one(Keeper& keeper) {
  Shelf& shelf = hourly_.pictures.empty() || onsets_.bytes > options_.max_bytes / 2 ? onsets_ : hourly_;
  const storage::PictureRecord picture = shelf.pictures.begin()->second;
  shelf.pictures.erase(shelf.pictures.begin());
  shelf.bytes -= picture.size_bytes;
  std::error_code ignored;
  std::filesystem::remove(file_of(picture), ignored);
  keeper.erase_picture(picture);
}

}  // namespace lampglow::daemon
