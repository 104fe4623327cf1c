// What a set of parameters costs, given a frame's rings: residuals of rings and priors, each softened against
// outliers, with their Jacobian.
#pragma once

#include <cstddef>
#include <vector>

#include "estimator/inference/joint_fit.h"

namespace lampglow::inference {

constexpr double kWideGainSigma = 3.0;  // of ln gain where the exposure is automatic

// r → sign(r)·√ρ(r²) with Cauchy's ρ = c² ln(1 + r²/c²): the same minimum as a loss function, in one residual
// block. `slope`: its derivative.
double soften(double r, double tail, double& slope);

// Refers to what it was made of, which must outlive it.
class FrameCost {
 public:
  FrameCost(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options);

  size_t parameter_count() const { return at_.size(); }
  size_t residual_count() const { return rings_.size() + 6 + 4 * at_.lamps + guests_; }

  // Half the sum of squared residuals is −ln p up to a constant. jacobian: row-major, or null.
  void evaluate(const double* p, double* residuals, double* jacobian) const;

 private:
  void priors(const double* p, double* residuals, double* jacobian) const;
  void guests(const double* p, double* residuals, double* jacobian) const;

  const Scene& scene_;
  const HaloModel& halo_;
  const RingData& data_;
  const FitOptions& options_;
  Layout at_;
  std::vector<size_t> rings_;
  size_t guests_ = 0;
  mutable Scene::Output output_;
};

double cost_at(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
               const std::vector<double>& p);

}  // namespace lampglow::inference
