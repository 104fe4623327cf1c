// A Video4Linux camera: exposure, gain and white balance locked, brackets by its exposure control.
#pragma once

#include <memory>

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

class V4l2Device;

class V4l2Camera : public FrameSource {
 public:
  explicit V4l2Camera(SourceOptions options);
  ~V4l2Camera() override;
  std::string name() const override { return options_.url; }

  // Exposures carry what the device read back: exposure_s where its control has a unit, and gain_db relative
  // to the locked gain (0 dB) or, with gain_db_per_step, of the sensor. A camera that would not lock gives
  // frames with camera_not_locked, `fault` says which control, and exposure_s is empty unless exposure itself
  // is held; so does one whose longest exposure is no brighter than the shortest.
  std::optional<Bracket> next(std::stop_token stop) override;
  void close() override;
  void set_bracket(const std::vector<ExposureSetting>& exposures) override { exposures_ = exposures; }
  SourceInfo describe(std::stop_token stop) override;

 private:
  using Deadline = std::chrono::steady_clock::time_point;
  void open();
  void lock();
  void lock_exposure();
  void lock_gain();
  void must_hold(std::uint32_t id, std::int64_t value, const char* what);
  bool take(const ExposureSetting* setting, Bracket& bracket, Deadline deadline, std::stop_token stop);
  std::optional<double> apply_exposure(const ExposureSetting& setting);
  std::optional<double> present_exposure_s() const;
  std::optional<double> gain_db() const;
  std::optional<Bracket> take_bracket(std::stop_token stop);

  const SourceOptions options_;
  std::vector<ExposureSetting> exposures_;
  std::unique_ptr<V4l2Device> device_;
  std::string not_locked_;         // what would not lock; empty: all is held
  std::uint32_t exposure_id_ = 0;  // the control that sets it; 0: none
  double exposure_unit_s_ = 0;
  bool exposure_held_ = false;
  std::uint32_t gain_id_ = 0;
};

}  // namespace lampglow::daemon
