// How sure the fit is: the covariance of its parameters, and the posterior of ln σ, profiled.
#pragma once

#include <vector>

#include "estimator/inference/frame_cost.h"

namespace lampglow::inference {

void add_covariance(const Scene& scene, const FrameCost& cost, const RingData& data,
                    const FitOptions& options, JointFit& fit);

// Walks from the best fit to both sides along ln σ, all else fitted at each step.
void add_posterior(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
                   double max_q, JointFit& fit);

// The lesser of two profiles at the points of both.
void merge_profiles(const std::vector<PosteriorPoint>& other, std::vector<PosteriorPoint>& profile);

}  // namespace lampglow::inference
