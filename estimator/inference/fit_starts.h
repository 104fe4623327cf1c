// Where the fit begins: a coarse scan of the parameters.
#pragma once

#include <vector>

#include "estimator/inference/joint_fit.h"

namespace lampglow::inference {

struct Start {
  double cost;
  std::vector<double> parameters, ln_dimming;
};

// A coarse scan over σ, with the gain as usual, dimmed by half, or with each lamp at its likeliest power; the
// best few that differ in σ or in powers.
std::vector<Start> starts(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FitOptions& options);

}  // namespace lampglow::inference
