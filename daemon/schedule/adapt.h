// The bracket's adaptation: the lamps' cores unsaturated in the shortest exposure, the sky above the noise in
// the longest.
#pragma once

#include <vector>

#include "daemon/sources/frame_source.h"
#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

struct AdaptOptions {
  double exposure_min_s = 1e-4;  // what the camera can do, and what is wanted of it
  double exposure_max_s = 2.0;
  double black_level_dn = 0;
  double saturation_dn = 255;
  double largest_step = 8;  // between neighbours of the bracket; more exposures are put between
  int most_exposures = 5;
};

// The next bracket, shortest first, from what the present one shows. Lamps: the 0.001 % brightest pixels of
// the shortest exposure (at least 4) shall be below 85 % of the range over black, and above 25 % if the
// longest exposure is longer. Sky: the median of the longest shall be at least 6 standard deviations of the
// pixel noise over black, and below 40 % of the range. Exposures move by at most a factor 4 at a time; what
// is inside its band is left alone, so that a steady night keeps its settings. The bracket's exposures must
// have a known exposure_s; if one has not, or there is none, `current` is given back.
std::vector<ExposureSetting> adapt_bracket(const std::vector<ExposureSetting>& current,
                                           const Bracket& bracket, const AdaptOptions& options);

}  // namespace lampglow::daemon
