#include "estimator/inference/joint_fit.h"

#include <algorithm>
#include <cmath>

#include "estimator/inference/modes.h"
#include "estimator/inference/profile.h"

namespace lampglow::inference {
namespace {

JointFit finish(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
                const FrameCost& cost, double max_q, Solved best) {
  JointFit fit;
  fit.converged = best.converged;
  fit.message = best.message;
  fit.cost = best.cost;
  fit.parameters = std::move(best.parameters);
  const Covariance covariance = covariance_at(scene, cost, data, options, fit.parameters);
  fit.sigma = covariance.deviations;
  Scene::Output output;
  scene.evaluate(halo, fit.parameters, data.lit, data.sky_unit, output, false);
  fit.model = output.model;
  int count = 0;
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    const double z = (fit.model[r] - data.value[r]) / data.sigma[r];
    fit.chi2_per_ring += std::min(z * z, 100.0);
    ++count;
  }
  if (count > 0) fit.chi2_per_ring /= count;
  if (options.posterior) add_posterior(scene, cost, data, options, covariance.along_ln_sigma, max_q, fit);
  return fit;
}

JointFit finish(const Scene& scene, const HaloModel& halo, const FitOptions& options, const Mode& mode) {
  const FrameCost cost(scene, halo, mode.data, options);
  JointFit fit = finish(scene, halo, mode.data, options, cost, halo.max_q(), mode.solved);
  fit.ln_dimming = mode.data.ln_dimming;
  fit.cost += mode.penalty;
  for (PosteriorPoint& point : fit.posterior) point.minus_ln_probability += mode.penalty;
  return fit;
}

}  // namespace

JointFit complete(const Scene& scene, const HaloModel& halo, const FitOptions& options, Modes found) {
  constexpr double kRival = 4.5;  // −Δ ln p of the modes that the bounds must cover, inflated ones too
  Mode best = found.modes.at(0);
  JointFit fit = finish(scene, halo, options, best);
  // The walk along ln σ may come upon a deeper minimum: then the fit starts anew from there, once.
  if (!fit.deeper.empty()) {
    Mode again = mode_at(scene, halo, best, options, fit.deeper, found.iterations);
    if (again.cost() < fit.cost) {
      fit = finish(scene, halo, options, again);
      best = std::move(again);
    }
  }
  std::vector<const Mode*> covered{&best};
  for (const Mode& mode : found.modes) {
    const bool known = std::any_of(covered.begin(), covered.end(), [&](const Mode* c) {
      return c->data.ln_dimming == mode.data.ln_dimming &&
             std::abs(c->solved.parameters[Layout::ln_sigma] - mode.solved.parameters[Layout::ln_sigma]) <
                 0.05;
    });
    if (known || !options.posterior || mode.cost() > fit.cost + kRival) continue;
    covered.push_back(&mode);
    merge_profiles(finish(scene, halo, options, mode).posterior, fit.posterior);
  }
  fit.iterations = found.iterations;
  return fit;
}

JointFit fit_jointly(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options) {
  return complete(scene, halo, options, find_modes(scene, halo, data, options));
}

}  // namespace lampglow::inference
