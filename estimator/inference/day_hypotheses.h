// What the brightness of the targets can mean: dark targets in haze, as ever; low sun on them; snow; one of
// them that is not what it was. Each is a fit of its own, and every σ counts by what all of them say, with
// their odds.
#pragma once

#include "estimator/inference/contrast_day.h"

namespace lampglow::inference {

struct SceneFit {
  ContrastFit fit;    // its posterior is that of all hypotheses
  bool snow = false;  // is what speaks for the best σ
  bool odd = false;   // the targets contradict each other under each hypothesis that has them all right
};

// `flags`: low_sun, sun_in_picture and rain_on_window count.
SceneFit fit_scene(const DayView& view, const Site& site, const DayOptions& options, QualityFlags flags);

}  // namespace lampglow::inference
