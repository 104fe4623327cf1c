#include "daemon/commands/validation.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lampglow::daemon {
namespace {

using scattering::Estimate;
using scattering::GlowModel;
constexpr double kDegree = std::numbers::pi / 180;
constexpr double kQ[] = {0.75, 0.85, 0.93};
constexpr int kConcentrations = 15;
constexpr std::size_t kRings = 24;

struct Misfit {
  double mean = 0, rms = 0;  // of ln(photons/model)
};

// Rings count by 1/(1 % + noise)², and what noise alone would give is subtracted.
std::optional<Misfit> misfit(GlowModel model, const PhotonProfile& photons, double thickness, double q,
                             bool free_scale) {
  if (model == GlowModel::apsf_series && thickness < kApsfLeastFitted) return std::nullopt;
  if (!scattering::outside_glow_model(model, thickness, q, 1, photons.theta_rad).empty()) return std::nullopt;
  std::vector<double> value(photons.theta_rad.size()), unused(value.size()), unused_too(value.size());
  scattering::glow_profile(model, thickness, q, 1, photons.theta_rad, value, unused, unused_too);
  double whole = 0, mean = 0, squares = 0, noise = 0;
  for (const bool second : {false, true})
    for (std::size_t i = 0; i < value.size(); ++i) {
      const Estimate& truth = photons.radiance[i];
      if (!(truth.value > 0) || !(value[i] > 0)) continue;
      const double sigma = truth.sigma / truth.value, weight = 1 / (1e-4 + sigma * sigma);
      const double off = std::log(truth.value / value[i]);
      if (!second) {
        whole += weight;
        mean += weight * off;
      } else {
        const double rest = off - (free_scale ? mean / whole : 0);
        squares += weight * rest * rest / whole;
        noise += weight * sigma * sigma / whole;
      }
    }
  return Misfit{mean / whole, std::sqrt(std::max(0.0, squares - noise))};
}

struct Best {
  double log_thickness = 0, q = 0;
  std::optional<Misfit> misfit;

  void try_at(GlowModel model, const PhotonProfile& photons, double log_t, double q_value) {
    const auto found = daemon::misfit(model, photons, std::exp(log_t), q_value, true);
    if (found && (!misfit || found->rms < misfit->rms)) *this = {log_t, q_value, found};
  }
};

}  // namespace

std::vector<PhotonProfile> count_photons(const ValidationOptions& options,
                                         const scattering::Executor& executor) {
  std::vector<PhotonProfile> result;
  for (const double q : kQ) {
    scattering::GlowPhotons run;
    run.q = q;
    run.photons = options.photons;
    run.seed = options.seed;
    run.theta_edges_rad = scattering::log_spaced_edges_rad(0.23, 13, kRings);
    for (int i = 0; i < kConcentrations; ++i)
      run.thicknesses.push_back(0.3 * std::pow(8 / 0.3, i / (kConcentrations - 1.0)));
    const scattering::GlowEstimate glow = scattering::simulate_glow(run, executor);
    for (std::size_t t = 0; t < run.thicknesses.size(); ++t) {
      PhotonProfile profile{run.thicknesses[t], q, {}, {}};
      for (std::size_t b = 0; b < kRings; ++b) {
        profile.theta_rad.push_back((run.theta_edges_rad[b] + run.theta_edges_rad[b + 1]) / 2);
        profile.radiance.push_back(glow.total(0, t, b));
      }
      result.push_back(std::move(profile));
    }
  }
  return result;
}

std::optional<ModelError> error_as_given(GlowModel model, const PhotonProfile& photons) {
  const auto found = misfit(model, photons, photons.thickness, photons.q, false);
  if (!found) return std::nullopt;
  return ModelError{found->rms, photons.thickness, photons.q, 1};
}

// A grid over the model's domain and the photons' own T and q, then ever smaller steps about the best: it
// needs no derivatives and cannot be led astray by models that end at their bounds. Without the true T and q
// the steps ended in the narrow valley of thin air, where T and brightness stand for each other.
std::optional<ModelError> error_when_fitted(GlowModel model, const PhotonProfile& photons) {
  Best best;
  best.try_at(model, photons, std::log(photons.thickness), photons.q);
  constexpr int kThicknesses = 15, kQs = 10;  // from 0.05 by 0.4 of ln T, from 0 by 0.1
  for (int i = 0; i < kThicknesses; ++i)
    for (int k = 0; k < kQs; ++k) best.try_at(model, photons, std::log(0.05) + 0.4 * i, 0.1 * k);
  if (model == GlowModel::apsf_series)
    for (int k = 0; k < kQs; ++k) best.try_at(model, photons, std::log(kApsfLeastFitted), 0.1 * k);
  if (!best.misfit) return std::nullopt;
  for (double step_t = 0.2, step_q = 0.05; step_t > 1e-3;) {
    const Best before = best;
    for (const double dt : {-1.0, 0.0, 1.0})
      for (const double dq : {-1.0, 0.0, 1.0})
        best.try_at(model, photons, before.log_thickness + dt * step_t,
                    std::max(0.0, before.q + dq * step_q));
    if (best.misfit->rms < before.misfit->rms) continue;
    step_t /= 2;
    step_q /= 2;
  }
  return ModelError{best.misfit->rms, std::exp(best.log_thickness), best.q, std::exp(best.misfit->mean)};
}

}  // namespace lampglow::daemon
