#include "daemon/sources/v4l2_camera.h"

#include <fmt/format.h>
#include <linux/videodev2.h>

#include <algorithm>
#include <cmath>

#include "daemon/sources/checks.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/v4l2_device.h"

namespace lampglow::daemon {
namespace {

// After a control was set, frames that were exposed before are still on their way: a sensor's pipeline is two
// or three frames long.
constexpr int kSettleFrames = 4;
// A stream's first frame may be torn; more than this running is a fault.
constexpr int kMostTornFrames = 5;

}  // namespace

V4l2Camera::V4l2Camera(SourceOptions options) : options_(std::move(options)), exposures_(options_.bracket) {}
V4l2Camera::~V4l2Camera() = default;

void V4l2Camera::close() {
  device_.reset();
}

void V4l2Camera::open() {
  if (device_) return;
  auto device = std::make_unique<V4l2Device>(options_.url.substr(options_.url.find(':') + 1));
  device->choose_format(options_.pixel_format, options_.width_px, options_.height_px);
  device_ = std::move(device);
  lock();
}

// A control that the device has must take the value and keep it.
void V4l2Camera::must_hold(std::uint32_t id, std::int64_t value, const char* what) {
  if (!device_->control(id) || device_->set_control(id, value) == value) return;
  not_locked_ += fmt::format("{}{} would not lock", not_locked_.empty() ? "" : ", ", what);
}

void V4l2Camera::lock() {
  not_locked_.clear();
  lock_exposure();
  lock_gain();
  must_hold(V4L2_CID_AUTO_WHITE_BALANCE, 0, "white balance");
  device_->set_control(V4L2_CID_BACKLIGHT_COMPENSATION, 0);
}

void V4l2Camera::lock_exposure() {
  must_hold(V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL, "exposure");
  device_->set_control(V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0);
  exposure_held_ = not_locked_.empty();
  exposure_id_ = 0;
  if (device_->control(V4L2_CID_EXPOSURE_ABSOLUTE)) {
    exposure_id_ = V4L2_CID_EXPOSURE_ABSOLUTE;
    exposure_unit_s_ = 1e-4;  // by the V4L2 specification
  } else if (device_->control(V4L2_CID_EXPOSURE)) {
    exposure_id_ = V4L2_CID_EXPOSURE;
    exposure_unit_s_ = options_.exposure_unit_s.value_or(0);
  } else {
    exposure_held_ = false;
    not_locked_ += std::string(not_locked_.empty() ? "" : ", ") + "the camera has no exposure control";
  }
}

void V4l2Camera::lock_gain() {
  must_hold(V4L2_CID_AUTOGAIN, 0, "gain");
  gain_id_ = 0;
  for (const std::uint32_t id : {V4L2_CID_GAIN, V4L2_CID_ANALOGUE_GAIN}) {
    const auto control = device_->control(id);
    if (!control) continue;
    gain_id_ = id;
    must_hold(id,
              std::clamp<std::int64_t>(options_.gain_step.value_or(static_cast<int>(control->minimum)),
                                       control->minimum, control->maximum),
              "gain");
    return;
  }
}

std::optional<double> V4l2Camera::present_exposure_s() const {
  if (!exposure_held_ || exposure_id_ == 0 || exposure_unit_s_ <= 0) return std::nullopt;
  const auto control = device_->control(exposure_id_);
  return control ? std::optional(static_cast<double>(control->value) * exposure_unit_s_) : std::nullopt;
}

std::optional<double> V4l2Camera::gain_db() const {
  if (not_locked_.find("gain") != std::string::npos) return std::nullopt;
  if (gain_id_ == 0 || !options_.gain_db_per_step) return 0.0;  // relative to the locked gain
  const auto control = device_->control(gain_id_);
  return control ? std::optional(static_cast<double>(control->value) * *options_.gain_db_per_step)
                 : std::nullopt;
}

// What the device then has, in seconds.
std::optional<double> V4l2Camera::apply_exposure(const ExposureSetting& setting) {
  if (exposure_id_ == 0 || exposure_unit_s_ <= 0) return std::nullopt;
  const auto control = device_->control(exposure_id_);
  if (!control) return std::nullopt;
  const auto wanted = std::clamp<std::int64_t>(std::llround(setting.exposure_s / exposure_unit_s_),
                                               control->minimum, control->maximum);
  if (control->value != wanted) device_->set_control(exposure_id_, wanted);
  return present_exposure_s();
}

// False when stopped.
bool V4l2Camera::take(const ExposureSetting* setting, Bracket& bracket, Deadline deadline,
                      std::stop_token stop) {
  const auto exposure_s = setting == nullptr ? present_exposure_s() : apply_exposure(*setting);
  RawFrame frame;
  for (int settle = 0; settle < kSettleFrames; ++settle) {
    if (!device_->next_frame(frame, deadline, stop)) return false;
  }
  for (int torn = 0;; ++torn) {
    if (!device_->next_frame(frame, deadline, stop)) return false;
    try {
      bracket.exposures.push_back(decode_raw_frame(frame, name(), options_.max_pixels));
      break;
    } catch (const SourceError& error) {
      if (error.fault() != Fault::torn || torn == kMostTornFrames) throw;
    }
  }
  Exposure& exposure = bracket.exposures.back();
  exposure.gain_db = gain_db();
  exposure.exposure_s = exposure_s;
  if (exposure_s && present_exposure_s() != exposure_s) {  // read back after the frame, too
    throw SourceError(Fault::not_locked, name() + ": the exposure changed while the frame was taken");
  }
  return true;
}

std::optional<Bracket> V4l2Camera::take_bracket(std::stop_token stop) {
  open();
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  const auto longest = std::ranges::max_element(exposures_, {}, &ExposureSetting::exposure_s);
  if (longest != exposures_.end()) device_->set_frame_interval(longest->exposure_s);
  device_->start();
  Bracket bracket;
  bracket.time_utc = utc_now();
  if (exposures_.empty() || exposure_id_ == 0) {
    if (!take(nullptr, bracket, deadline, stop)) return std::nullopt;
  } else {
    for (const ExposureSetting& setting : exposures_) {
      if (!take(&setting, bracket, deadline, stop)) return std::nullopt;
    }
  }
  if (!options_.stay_connected) device_->stop();
  std::string why = not_locked_;
  if (!follows_exposure(bracket, device_->bit_depth())) {
    why += std::string(why.empty() ? "" : ", ") + "the pictures do not follow the exposure that was set";
    for (Exposure& exposure : bracket.exposures) exposure.exposure_s.reset();
  }
  if (!why.empty()) {
    bracket.quality.set(Quality::camera_not_locked);
    bracket.fault = "not_locked: " + why;
  }
  return bracket;
}

std::optional<Bracket> V4l2Camera::next(std::stop_token stop) {
  try {
    return take_bracket(stop);
  } catch (...) {
    close();
    throw;
  }
}

SourceInfo V4l2Camera::describe(std::stop_token) {
  open();
  SourceInfo info;
  info.driver = device_->driver();
  info.bit_depth = device_->bit_depth();
  info.formats.push_back(device_->format_text() +
                         fmt::format(", {:.4g} frames/s", device_->frame_rate_hz().value_or(0)));
  for (const std::string& format : device_->list_formats()) info.formats.push_back(format);
  for (const V4l2Control& control : device_->list_controls()) {
    info.controls.push_back(fmt::format("{} {}..{} step {}, now {}", control.name, control.minimum,
                                        control.maximum, control.step, control.value));
  }
  const auto exposure = exposure_id_ == 0 ? std::nullopt : device_->control(exposure_id_);
  if (exposure && exposure_unit_s_ > 0) {
    info.exposure_min_s =
        static_cast<double>(std::max<std::int64_t>(exposure->minimum, 1)) * exposure_unit_s_;
    info.exposure_max_s = static_cast<double>(exposure->maximum) * exposure_unit_s_;
  }
  info.locked = not_locked_.empty();
  if (!not_locked_.empty()) info.notes.push_back("Not locked: " + not_locked_ + ".");
  if (exposure && exposure_unit_s_ <= 0) {
    info.notes.push_back("The exposure control has no unit: measure its step and give exposure_unit_s.");
  }
  return info;
}

}  // namespace lampglow::daemon
