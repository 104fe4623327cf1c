// The joint fit: all lamps share σ and q, each has its strength, all share a drift of camera and window.
// Least squares with Ceres on the rings, a robust loss against cars and foreign lights, priors as further
// residuals.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "estimator/inference/scene.h"

namespace lampglow::inference {

// What was measured: one value per ring of the scene.
struct RingData {
  std::vector<double> value;
  std::vector<double> sigma;       // one standard deviation, model error included
  std::vector<char> used;          // 0: no value
  std::vector<char> lit;           // per lamp; 0: it is off, its rings still count
  std::vector<double> ln_dimming;  // per lamp: prior mean of ln strength, 0 or ln ½; empty: all 0
  double sky_unit = 1;             // a typical background, to scale the sky's parameters
  std::vector<double> noise;       // the part of sigma that is the picture's own noise
};

struct FitOptions {
  double ln_gain_sigma = 0.12;  // drift of camera and window together
  bool gain_known = true;       // false: automatic exposure, prior on ln gain is ±3
  double q_mean_fog = 0.86;     // prior mean of q at MOR 300 m; it falls with the logarithm of MOR ...
  double q_mean_haze = 0.62;    // ... towards this in haze ...
  double q_mean_clear = 0.45;   // ... and to this at 30 km
  double q_sigma = 0.10;        // up to some 5 km ...
  double q_sigma_clear = 0.25;  // ... and widening to this: clear air may be anything from gas to haze
  double kappa_sigma = 0.0;     // of ln κ; 0: the point spread's own core uncertainty
  double emission_mean = 0.03;  // c: even lamps have 0, full cut-off ones 0.1 to 0.3
  double emission_sigma = 0.06;
  double ln_half = 0;        // a lamp's other power, as ln of its usual; 0: it has none
  double slope_sigma = 1.0;  // of the sky's gradient, in sky units per half picture
  double prior_tail = 2.5;   // strengths and gain: beyond this many σ the prior's pull fades (Cauchy)
  double ring_tail = 2.5;    // the same for rings
  int max_iterations = 40;
  double min_mor_m = 12, max_mor_m = 400e3;  // where σ is searched
  bool posterior = true;                     // profile ln σ for the bounds
  std::function<bool()> given_up;            // asked now and then; true: FitStopped, never half an answer
};

// Thrown if the caller no longer wants the answer. No std::exception, for it is no fault.
struct FitStopped {};
void stop_if_given_up(const std::function<bool()>& given_up);
void stop_if_given_up(const FitOptions& options);

// A point of the profiled posterior of ln σ.
struct PosteriorPoint {
  double ln_sigma = 0, minus_ln_probability = 0, q = 0, q_sigma = 0;
};

struct JointFit {
  bool converged = false;
  int iterations = 0;
  std::string message;             // Ceres' own words where it did not converge
  double cost = 0;                 // −ln posterior, up to a constant
  std::vector<double> parameters;  // see Layout
  std::vector<double> sigma;       // standard deviations of the same; 0 where held
  std::vector<double> model;       // of every ring
  double chi2_per_ring = 0;
  std::vector<double> ln_dimming;         // per lamp: the power it burns at, 0 or ln_half
  std::vector<PosteriorPoint> posterior;  // ordered by ln_sigma; includes the best; least over rival modes
  std::vector<double> deeper;             // parameters of a point of the walk that beats the best; else empty
  double ln_sigma() const { return parameters[Layout::ln_sigma]; }
};

double prior_q(double ln_sigma, const FitOptions& options);
double prior_q_sigma(double ln_sigma, const FitOptions& options);

JointFit fit_jointly(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options);

// Residuals and Jacobian as the solver sees them: for tests against finite differences and for comparisons.
struct Residuals {
  std::vector<double> value, jacobian;  // row-major, Layout::size() columns
};
Residuals residuals_at(const Scene& scene, const HaloModel& halo, const RingData& data,
                       const FitOptions& options, std::span<const double> parameters);

}  // namespace lampglow::inference
