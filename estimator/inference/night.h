// The night's method: from a registered frame and the clear reference to extinction, q and weather.
#pragma once

#include <optional>

#include "estimator/inference/joint_fit.h"
#include "estimator/inference/posterior.h"
#include "estimator/inference/reference.h"
#include "estimator/observation.h"

namespace lampglow::inference {

struct NightOptions {
  FitOptions fit;
  RingErrors errors;
  // Rings share errors that the fit takes for independent. With 1.3 the bounds of brackets were too wide: 101
  // of 101 truths of another program's nights lay within them, their errors 0.73 of what the bounds say in
  // the mean square. 1.2 leaves a margin, for few lamps above all.
  BoundsOptions bounds{.inflate = 1.2};
  // Of one exposure alone what its response and its saturation do to all rings alike is not known better than
  // the floor. Of seven webcam archives of another program 132 of 153 truths lay within the bounds without
  // it, 141 with it.
  double single_exposure_inflate = 1.3, single_exposure_ln_floor = 0.07;
  double ln_half = -0.6931;     // lamps dimmed at night burn at half power
  double faint_sigma = 5;       // a lamp that should show by this many σ and does not is off
  int few_lights = 3;           // fewer lamps than this set the flag
  double gain_drift_ln = 0.25;  // flag beyond this
  double poor_chi2 = 6.0;       // mean squared residual of a ring in σ², flag beyond this
  // Lights of one frame alone, whose halos lie over the rings: this many, the brightest, at a distance that
  // is a guess; their light is known by what is seen of it, less well where it is saturated.
  int max_guests = 6;
  double guest_distance_m = 250, guest_distance_ln_sigma = 0.7;
  double guest_strength_ln_sigma = 2, guest_saturated_ln_sigma = 1;
  // A luminaire that sends its light down has another halo than an even lamp, and its q reads too high: on
  // two cut-off archives of another program by 0.01 to 0.02 in fog and up to 0.12 in haze. One standard
  // deviation of that is this times (1 − q)², in q's bounds and the weather's classes alone.
  double luminaire_q_sigma = 2;
  double q_known_ratio = 0.75;  // q is given if its posterior σ is below this part of its prior's
};

// Fills observation, lamps and reason of `result` (its time, shift and frame flags are the caller's).
void measure_night(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                   const Site& site, const ClearReference& reference, const HaloModel& halo,
                   std::optional<double> relative_humidity, const NightOptions& options, FrameResult& result);

}  // namespace lampglow::inference
