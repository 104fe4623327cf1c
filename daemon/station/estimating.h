// What the station's workers do: a camera's frame in, its result and pictures out.
#pragma once

#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "daemon/station/config.h"
#include "daemon/station/picture.h"
#include "estimator/estimate.h"

namespace lampglow::daemon {

// Everything that a frame's estimate depends on; replaced as a whole when the configuration changes.
struct CameraSetup {
  std::string name;
  Site site;
  std::optional<ClearReference> base;       // as the clear brackets give it
  std::optional<ClearReference> reference;  // with what service taught since
  std::optional<inference::RelearnOptions> relearn;
  EstimatorOptions estimator;
};

struct Job {
  std::shared_ptr<const CameraSetup> setup;
  Bracket bracket;
};

struct Done {
  std::shared_ptr<const CameraSetup> setup;
  FrameResult result;
  Pictures pictures;
  double duration_s = 0;
};

// From the camera's reference archive; none without one. Throws what reading it throws, and Stopped soon
// after `stop` asked for it.
std::shared_ptr<const CameraSetup> set_up(const CameraConfig& camera, const std::stop_token& stop);

// Never throws for what the estimator does: a failure is a result without a value that says why, and so is a
// frame that was given up because `give_up` asked for it. That one has no pictures.
Done estimate_job(const Job& job, int jpeg_quality, const std::stop_token& give_up);

}  // namespace lampglow::daemon
