// Twilight: one answer from the lamps and the targets of the same frame.
#pragma once

#include <optional>

#include "estimator/observation.h"

namespace lampglow::inference {

struct CombineOptions {
  // Over these sun altitudes a method fades: the weight of its inverse variance goes from 1 to 0 without a
  // step.
  double contrast_full_deg = 2, contrast_none_deg = -6;
  double glow_full_deg = -4, glow_none_deg = 4;
};

// The weight of each method at the sun's altitude, 0..1. Unknown altitude: 1 for both.
double contrast_weight(std::optional<double> sun_altitude_deg, const CombineOptions& options);
double glow_weight(std::optional<double> sun_altitude_deg, const CombineOptions& options);

// Two observations of one frame, either of which may have no value. Values are averaged in ln σ with their
// inverse variances times the weights, the error grown where they disagree beyond their bounds. A limit gives
// way to a value that it does not contradict, and, if it alone is of a poor fit, to any; of two limits of one
// kind the tighter holds. The method is the one that weighed more; quality flags are those of both, without
// `daylight` and `twilight`, which the caller sets.
Observation combine(const Observation& glow, const Observation& contrast,
                    std::optional<double> sun_altitude_deg, const CombineOptions& options = {});

}  // namespace lampglow::inference
