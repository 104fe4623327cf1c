#include "daemon/sources/libcamera_camera.h"

#include "daemon/errors.h"

#if LAMPGLOW_HAS_LIBCAMERA
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "daemon/sources/checks.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/libcamera_session.h"

namespace lampglow::daemon {
namespace {

namespace lc = libcamera;
using lc::ControlValue;

// A camera that tells nothing of its exposure: frames that were exposed before a change are still on their
// way.
constexpr int kSettleFrames = 4;
// One that does tell has as many to come to the exposure that was set.
constexpr int kMostSettleFrames = 16;
// A stream's first frame may be torn; more than this running is a fault.
constexpr int kMostTornFrames = 5;
// Without a wish: for a first look at a night. The adaptation goes on from there.
constexpr double kFirstExposure_s = 0.02;

double decibels(double factor) {
  return 20 * std::log10(factor);
}

class LibcameraCamera : public FrameSource {
 public:
  explicit LibcameraCamera(SourceOptions options)
      : options_(std::move(options)), exposures_(options_.bracket) {}
  std::string name() const override { return options_.url; }
  std::optional<Bracket> next(std::stop_token stop) override;
  void close() override { session_.reset(); }
  void set_bracket(const std::vector<ExposureSetting>& exposures) override { exposures_ = exposures; }
  SourceInfo describe(std::stop_token stop) override;

 private:
  using Deadline = LibcameraSession::Deadline;
  bool open(Deadline deadline, std::stop_token stop);
  bool lock(Deadline deadline, std::stop_token stop);
  lc::ControlList lock_settings() const;
  void put(lc::ControlList& settings, const char* name, const ControlValue& value) const;
  void make_room(lc::ControlList& settings) const;
  std::vector<ExposureSetting> wanted() const;
  std::optional<double> limit_of_exposure_s(bool highest) const;
  lc::ControlList settings_for(const ExposureSetting& setting, Exposure& accepted) const;
  bool take(const ExposureSetting& setting, Bracket& bracket, Deadline deadline, std::stop_token stop);
  bool is_in(const lc::ControlList& metadata, const Exposure& accepted, int& settled);
  void read_back(const lc::ControlList& metadata, Exposure& exposure) const;
  std::optional<Bracket> take_bracket(std::stop_token stop);
  void add_problem(const std::string& what) { problems_ += (problems_.empty() ? "" : ", ") + what; }

  const SourceOptions options_;
  std::vector<ExposureSetting> exposures_;
  std::unique_ptr<LibcameraSession> session_;
  std::string not_locked_;  // what would not lock when it was opened; empty: all is held
  std::string problems_;    // of the bracket at hand
  bool tells_exposure_ = false;
};

// Only what the camera has.
void LibcameraCamera::put(lc::ControlList& settings, const char* name, const ControlValue& value) const {
  if (const auto* id = control_of(session_->camera(), name)) settings.set(id->id(), value);
}

std::optional<double> LibcameraCamera::limit_of_exposure_s(bool highest) const {
  const auto* id = control_of(session_->camera(), "ExposureTime");
  if (id == nullptr) return std::nullopt;
  const lc::ControlInfo range = range_of(session_->camera(), *id);
  return std::max((highest ? range.max() : range.min()).get<std::int32_t>(), 1) * 1e-6;
}

std::vector<ExposureSetting> LibcameraCamera::wanted() const {
  return exposures_.empty() ? std::vector<ExposureSetting>{{kFirstExposure_s, {}}} : exposures_;
}

// Everything automatic off.
lc::ControlList LibcameraCamera::lock_settings() const {
  lc::ControlList settings(session_->camera().controls());
  put(settings, "AeEnable", false);
  put(settings, "ExposureTimeMode", std::int32_t{1});  // manual; releases of 2025 and later
  put(settings, "AnalogueGainMode", std::int32_t{1});
  put(settings, "AwbEnable", false);
  put(settings, "AfMode", std::int32_t{0});  // manual
  put(settings, "HdrMode", std::int32_t{0});
  return settings;
}

// Room for the bracket's longest exposure: a sensor exposes no longer than its frames last.
void LibcameraCamera::make_room(lc::ControlList& settings) const {
  const auto* id = control_of(session_->camera(), "FrameDurationLimits");
  if (id == nullptr) return;
  const lc::ControlInfo range = range_of(session_->camera(), *id);
  const auto lowest = range.min().get<std::int64_t>(), highest = range.max().get<std::int64_t>();
  const double longest_s = std::ranges::max(wanted(), {}, &ExposureSetting::exposure_s).exposure_s;
  const std::int64_t room_us =
      std::clamp<std::int64_t>(std::llround(longest_s * 1.1e6) + 10'000, lowest, highest);
  const std::int64_t limits[2] = {lowest, room_us};
  settings.set(id->id(), lc::Span<const std::int64_t>(limits));
}

// A camera cancels a request with controls that it refuses. Whether it is that or the hardware, a second
// start without them tells.
bool LibcameraCamera::lock(Deadline deadline, std::stop_token stop) {
  session_->set(lock_settings());
  session_->start(lock_settings());
  lc::Request* first = session_->next(deadline, stop);
  if (first == nullptr) return false;
  if (first->status() == lc::Request::RequestCancelled) {
    session_->stop();
    const lc::ControlList none(session_->camera().controls());
    session_->set(none);
    session_->start(none);
    first = session_->next(deadline, stop);
    if (first == nullptr) return false;
    if (first->status() == lc::Request::RequestCancelled)
      throw SourceError(Fault::device_timeout, name() + ": libcamera cancels every request");
    not_locked_ = "exposure would not lock";
  } else if (control_of(session_->camera(), "ExposureTime") == nullptr) {
    not_locked_ = "the camera has no exposure control";
  }
  tells_exposure_ = !told(first->metadata(), "ExposureTime").isNone();
  session_->stop();
  return true;
}

// False when stopped.
bool LibcameraCamera::open(Deadline deadline, std::stop_token stop) {
  if (session_) return true;
  session_ = std::make_unique<LibcameraSession>(options_);
  not_locked_.clear();
  return lock(deadline, stop);
}

// What a request for this exposure carries; `accepted` gets what the camera then has if it keeps it.
lc::ControlList LibcameraCamera::settings_for(const ExposureSetting& setting, Exposure& accepted) const {
  lc::ControlList settings(session_->camera().controls());
  if (!not_locked_.empty()) return settings;  // it would cancel them
  const double exposure_s =
      std::clamp(setting.exposure_s, *limit_of_exposure_s(false), *limit_of_exposure_s(true));
  const auto exposure_us = static_cast<std::int32_t>(std::llround(exposure_s * 1e6));
  put(settings, "ExposureTime", exposure_us);
  make_room(settings);
  accepted.exposure_s = exposure_us * 1e-6;
  const auto* gain = control_of(session_->camera(), "AnalogueGain");
  if (gain == nullptr) {
    accepted.gain_db = 0;
  } else {
    const lc::ControlInfo range = range_of(session_->camera(), *gain);
    const auto lowest = range.min().get<float>(), highest = range.max().get<float>();
    const double factor = setting.gain_db ? std::pow(10, *setting.gain_db / 20) : lowest;
    settings.set(gain->id(), std::clamp(static_cast<float>(factor), lowest, highest));
    if (!setting.gain_db) accepted.gain_db = 0;  // relative to the locked gain
  }
  return settings;
}

// Whether the new exposure is in this picture. A camera that tells it is believed; of another so many
// pictures are passed over.
bool LibcameraCamera::is_in(const lc::ControlList& metadata, const Exposure& accepted, int& settled) {
  const ControlValue exposure_us = told(metadata, "ExposureTime");
  ++settled;
  if (exposure_us.isNone() || !accepted.exposure_s) return settled + session_->passed_over() > kSettleFrames;
  const double has_s = exposure_us.get<std::int32_t>() * 1e-6, wanted_s = *accepted.exposure_s;
  if (std::abs(has_s - wanted_s) <= std::max(1e-4, 0.02 * wanted_s)) return true;  // a sensor counts in lines
  if (settled <= kMostSettleFrames) return false;
  add_problem(fmt::format("exposure set to {:g} s stays at {:g} s", wanted_s, has_s));
  return true;
}

void LibcameraCamera::read_back(const lc::ControlList& metadata, Exposure& exposure) const {
  const ControlValue exposure_us = told(metadata, "ExposureTime"), gain = told(metadata, "AnalogueGain");
  // In a camera that would not lock, too: it is what this picture had.
  if (!exposure_us.isNone()) exposure.exposure_s = exposure_us.get<std::int32_t>() * 1e-6;
  if (!gain.isNone() && gain.get<float>() > 0) exposure.gain_db = decibels(gain.get<float>());
}

// False when stopped.
bool LibcameraCamera::take(const ExposureSetting& setting, Bracket& bracket, Deadline deadline,
                           std::stop_token stop) {
  Exposure accepted;
  const lc::ControlList settings = settings_for(setting, accepted);
  session_->set(settings);
  session_->start(not_locked_.empty() ? lock_settings() : settings);
  for (int settled = 0, torn = 0;;) {
    lc::Request* request = session_->next(deadline, stop);
    if (request == nullptr) return false;
    if (request->status() == lc::Request::RequestCancelled)
      throw SourceError(Fault::device_timeout,
                        name() + ": libcamera cancelled a request while running: the hardware timed out");
    if (is_in(request->metadata(), accepted, settled)) {
      try {
        Exposure exposure = session_->picture(*request, options_.max_pixels);
        exposure.exposure_s = accepted.exposure_s;
        exposure.gain_db = accepted.gain_db;
        read_back(request->metadata(), exposure);
        const ControlValue wall_ns = told(request->metadata(), "FrameWallClock");
        if (bracket.exposures.empty() && !wall_ns.isNone())
          bracket.time_utc = TimePoint(std::chrono::milliseconds(wall_ns.get<std::int64_t>() / 1'000'000));
        bracket.exposures.push_back(std::move(exposure));
        session_->give_back(request);
        return true;
      } catch (const SourceError& error) {
        if (error.fault() != Fault::torn || ++torn > kMostTornFrames) throw;
      }
    }
    session_->give_back(request);
  }
}

std::optional<Bracket> LibcameraCamera::take_bracket(std::stop_token stop) {
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  if (!open(deadline, stop)) return std::nullopt;
  problems_ = not_locked_;
  Bracket bracket;
  bracket.time_utc = utc_now();
  const bool settable = not_locked_.empty();
  for (const ExposureSetting& setting :
       settable ? wanted() : std::vector<ExposureSetting>{{kFirstExposure_s, {}}})
    if (!take(setting, bracket, deadline, stop)) return std::nullopt;
  if (!options_.stay_connected) session_->stop();
  if (!follows_exposure(bracket, session_->bit_depth())) {
    add_problem("the pictures do not follow the exposure that was set");
    for (Exposure& exposure : bracket.exposures) exposure.exposure_s.reset();
  }
  if (!problems_.empty()) {
    bracket.quality.set(Quality::camera_not_locked);
    bracket.fault = "not_locked: " + problems_;
  }
  return bracket;
}

std::optional<Bracket> LibcameraCamera::next(std::stop_token stop) {
  try {
    auto bracket = take_bracket(stop);
    if (!bracket) close();
    return bracket;
  } catch (...) {
    close();
    throw;
  }
}

// in_use: the format that the camera is configured for; empty: none.
SourceInfo info_of(lc::Camera& camera, const std::string& in_use) {
  SourceInfo info;
  const auto model = camera.properties().get(lc::properties::Model);
  info.driver = fmt::format("libcamera {}: {}", lc::CameraManager::version(),
                            model ? std::string(*model) : "unknown model");
  if (!in_use.empty()) info.formats.push_back(in_use);
  for (std::string& format : formats_of(camera)) info.formats.push_back(std::move(format));
  for (const auto& [id, range] : camera.controls())
    info.controls.push_back(fmt::format("{} {}", id->name(), range.toString()));
  std::ranges::sort(info.controls);
  return info;
}

SourceInfo LibcameraCamera::describe(std::stop_token stop) {
  if (!open(std::chrono::steady_clock::now() + options_.frame_timeout, stop)) return {};
  SourceInfo info = info_of(session_->camera(), session_->format_text());
  info.bit_depth = session_->bit_depth();
  info.exposure_min_s = limit_of_exposure_s(false);
  info.exposure_max_s = limit_of_exposure_s(true);
  info.locked = not_locked_.empty();
  if (!not_locked_.empty()) info.notes.push_back("Not locked: " + not_locked_ + ".");
  if (!tells_exposure_)
    info.notes.push_back(
        "The camera does not tell the exposure of its pictures: recorded is what it was set to.");
  return info;
}

}  // namespace

std::unique_ptr<FrameSource> open_libcamera(const SourceOptions& options) {
  return std::make_unique<LibcameraCamera>(options);
}

std::vector<LibcameraListing> list_libcamera() {
  const LibcameraManager manager;
  std::vector<LibcameraListing> list;
  for (const auto& camera : manager->cameras()) list.push_back({camera->id(), info_of(*camera, "")});
  return list;
}

}  // namespace lampglow::daemon

#else

namespace lampglow::daemon {

constexpr const char* kWithout =
    "this build has no libcamera: install libcamera-dev and build with -DLAMPGLOW_LIBCAMERA=ON";

std::unique_ptr<FrameSource> open_libcamera(const SourceOptions& options) {
  throw ConfigError("source '" + options.url + "': " + kWithout);
}
std::vector<LibcameraListing> list_libcamera() {
  throw ConfigError(kWithout);
}

}  // namespace lampglow::daemon
#endif
