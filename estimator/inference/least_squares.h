// The search for the parameters that cost least.
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "estimator/inference/frame_cost.h"

namespace lampglow::inference {

struct Limits {
  double ln_sigma_low, ln_sigma_high;
};

Limits limits_of(const FitOptions& options);

// Parameters that this scene and frame leave nothing to say about, in order.
std::vector<int> held_parameters(const Scene& scene, const RingData& data, const FitOptions& options,
                                 bool hold_sigma);

// All others, in order.
std::vector<int> free_parameters(const Scene& scene, const RingData& data, const FitOptions& options,
                                 bool hold_sigma);

struct Solved {
  double cost = std::numeric_limits<double>::infinity();
  bool converged = false;
  int iterations = 0;
  std::string message;
  std::vector<double> parameters;
};

Solved solve(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
             std::vector<double> start, bool hold_sigma, int max_iterations, double max_q);

}  // namespace lampglow::inference
