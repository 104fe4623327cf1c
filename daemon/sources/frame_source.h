// Where frames come from. Archives, simulated and real cameras are all alike behind this.
#pragma once

#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

// The settings for one exposure of a bracket.
struct ExposureSetting {
  double exposure_s = 0;            // > 0
  std::optional<double> gain_db{};  // empty: the camera's locked gain
  bool operator==(const ExposureSetting&) const = default;
};

// What a camera can do, for `probe` and for the bracket's adaptation.
struct SourceInfo {
  std::string driver;                 // of the device or the server, as it names itself
  std::vector<std::string> formats;   // "YUYV 1280x720 30 fps"; the one in use first
  std::vector<std::string> controls;  // "exposure_time_absolute 1..5000 step 1, now 157"
  std::optional<int> bit_depth{};     // of the samples; empty: as the picture file says
  std::optional<double> exposure_min_s{};
  std::optional<double> exposure_max_s{};
  std::optional<bool>
      locked;  // exposure, gain and white balance held where we set them; empty: can't be known
  std::vector<std::string> notes;  // what is wrong or missing, in words a person can act on
};

class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  // For messages; never holds a password.
  virtual std::string name() const = 0;

  // The next bracket; empty when there will be no more (an archive ends, a camera does not) or when stopped.
  //
  // An archive gives a frame that failed as a bracket with flags and a fault. A live camera takes a bracket
  // now (it opens whatever is not open), within its time-outs, and throws SourceError where it can't; it may
  // be asked again at any time after that.
  virtual std::optional<Bracket> next(std::stop_token stop) = 0;

  // Lets go of the device or connection; the next next() opens it again. For archives: nothing.
  virtual void close() {}

  // The exposures of the brackets from now on, shortest first. Sources that can't set them ignore it.
  virtual void set_bracket(const std::vector<ExposureSetting>&) {}

  // Opens the camera and says what it is. Throws SourceError.
  virtual SourceInfo describe(std::stop_token) { return {}; }
};

}  // namespace lampglow::daemon
