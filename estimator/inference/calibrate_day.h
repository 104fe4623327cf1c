// Learning a camera's targets for the day from a period of known visibility: how strong each one's texture
// is, how far it acts to be, and how it changes with the light.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "estimator/inference/contrast_fit.h"
#include "estimator/site.h"
#include "estimator/time.h"

namespace lampglow::inference {

// One daylight frame with what a sensor said at its time.
struct DaySample {
  TimePoint time_utc{};
  double mor_m = 0;  // > 0
  DayView view;      // of all targets to learn
};

struct DayLearningOptions {
  double truth_sigma = 0.15;  // ln: a sensor's point and minutes are not the camera's path and moment
  double scatter = 0.15;      // of ln contrast, to begin with
  double least_scatter = 0.06;
  double most_scatter = 0.35;                        // a target that is less steady is dropped
  double distance_m = 300, distance_ln_sigma = 1.2;  // prior of effective distances
  double floor_ln = -2.3, floor_ln_sigma = 0.7;      // prior of what stays in fog
  double lighting_sigma = 0.3;                       // of each target's answer to the light
  double nearest_m = 15;            // what acts nearer than this does not fade: dirt, overlay, noise
  double independent_targets = 12;  // neighbours share clouds, shadows and wind
  // Clearer frames are no test: their targets are hardly veiled. Learning without one of few hours is harder
  // than what the result is used for, so the error taken from it is held within bounds.
  double farthest_judged_m = 15e3;
  double least_error = 0.1, most_error = 0.5;
  int least_samples = 8;
  int least_targets = 5;
};

struct DayLearning {
  std::vector<Target> targets;  // those that held, with what was learned
  DayCalibration day;           // sky box as given
  int samples = 0;
  int cross_validated = 0;         // frames estimated from the other hours' learning
  double cross_median_abs_ln = 0;  // their median |ln(estimate/truth)|; 0 if none
};

// `skyline` tells for each target whether the sky's edge runs through its box: such contrast hardly changes
// with the light. Empty, with the reason in `why`, where the data can't support it: too few frames or
// targets, or a visibility that hardly changed.
std::optional<DayLearning> learn_day(const std::vector<DaySample>& samples,
                                     const std::vector<Target>& targets, const std::vector<bool>& skyline,
                                     const DayCalibration& day, const DayLearningOptions& options,
                                     std::string& why);

}  // namespace lampglow::inference
