// What the profiled posterior of ln σ says: a value with bounds, or a limit.
#pragma once

#include <optional>
#include <span>

#include "estimator/inference/joint_fit.h"
#include "estimator/observation.h"

namespace lampglow::inference {

struct BoundsOptions {
  double widest_ratio = 3.0;  // a value is given while σ's upper 95 % bound over its lower is at most this
  double restricted_mor_m = 5000;  // a limit "below" is preferred to "above" only within this visibility
  double inflate = 1.0;            // of the log-posterior's width, for model errors that rings share
  double ln_floor = 0;  // one standard deviation of ln σ that a value's bounds have on top, squares added
};

struct SigmaBounds {
  Limit limit = Limit::none;
  double value = 0;  // σ; for `above` (visibility above) the one-sided upper bound, for `below` the lower
  std::optional<double> low, high;  // 95 %, empty where open
  double ln_sd = 0;                 // half of the 68 % interval in ln σ
};

// Throws std::invalid_argument for an empty posterior.
SigmaBounds sigma_bounds(std::span<const PosteriorPoint> posterior, const BoundsOptions& options);

}  // namespace lampglow::inference
