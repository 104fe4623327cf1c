// How sure the fit is: the covariance of its parameters, and the posterior of ln σ, profiled.
#pragma once

#include <span>
#include <vector>

#include "estimator/inference/frame_cost.h"

namespace lampglow::inference {

// Of all parameters, 0 where held.
struct Covariance {
  std::vector<double> deviations;      // one standard deviation
  std::vector<double> along_ln_sigma;  // how they follow when ln σ is moved, per unit of it
};
Covariance covariance_at(const Scene& scene, const FrameCost& cost, const RingData& data,
                         const FitOptions& options, std::span<const double> parameters);

// Walks from the best fit to both sides along ln σ, all else fitted at each step.
void add_posterior(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
                   std::span<const double> along_ln_sigma, double max_q, JointFit& fit);

// The lesser of two profiles at the points of both.
void merge_profiles(const std::vector<PosteriorPoint>& other, std::vector<PosteriorPoint>& profile);

}  // namespace lampglow::inference
