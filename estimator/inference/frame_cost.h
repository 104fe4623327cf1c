// What a set of parameters costs, given a frame's rings: residuals of rings and priors, each softened against
// outliers, with their Jacobian.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "estimator/inference/joint_fit.h"

namespace lampglow::inference {

constexpr double kWideGainSigma = 3.0;  // of ln gain where the exposure is automatic

// r → sign(r)·√ρ(r²) with Cauchy's ρ = c² ln(1 + r²/c²): the same minimum as a loss function, in one residual
// block. `slope`: its derivative.
double soften(double r, double tail, double& slope);

// Jᵀ J, Jᵀ r and half of r² of some parameters.
struct NormalEquations {
  std::vector<double> information;  // square, symmetric
  std::vector<double> gradient;
  double cost = 0;
};

// Refers to what it was made of, which must outlive it.
class FrameCost {
 public:
  FrameCost(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options);

  size_t parameter_count() const { return at_.size(); }
  size_t residual_count() const { return rings_.size() + 6 + 4 * at_.lamps + guests_; }

  // Half the sum of squared residuals is −ln p up to a constant. jacobian: row-major, or null.
  void evaluate(const double* p, double* residuals, double* jacobian) const;

  // The same without the residuals: alone, for a model of all rings that is there already, and with the
  // normal equations of the parameters `active` (ascending), in which a lamp's sky counts in its own rings
  // alone.
  double cost(const double* p) const;
  double cost_of_model(const double* p, std::span<const double> model) const;
  NormalEquations normal_equations(const double* p, std::span<const int> active) const;

 private:
  // sink(residual, slopes) for every prior, in a fixed order.
  template <typename Sink>
  void each_prior(const double* p, Sink&& sink) const;
  template <typename Sink>
  void each_guest(const double* p, Sink&& sink) const;
  double ring_residual(size_t ring, double model, double& slope) const;
  void add_rings(const double* p, std::span<const int> active, NormalEquations& out) const;

  const Scene& scene_;
  const HaloModel& halo_;
  const RingData& data_;
  const FitOptions& options_;
  Layout at_;
  std::vector<size_t> rings_;
  size_t guests_ = 0;
  mutable Scene::Output output_;
};

}  // namespace lampglow::inference
