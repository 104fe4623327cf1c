#include "estimator/inference/frame_cost.h"

#include <algorithm>
#include <cmath>

#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

constexpr double kSkySigma = 30.0;

// 0 in fog, 1 in clear air.
double clearness(double ln_sigma) {
  const double ln_mor = std::log(kMorTimesExtinction) - ln_sigma;
  const double x = (ln_mor - std::log(300.0)) / (std::log(30e3) - std::log(300.0));
  return 1.0 / (1.0 + std::exp(-6.0 * (x - 0.5)));
}

// 0 up to some 5 km, 1 in clear air.
double beyond_haze(double ln_sigma) {
  return std::max(0.0, clearness(ln_sigma) - 0.6) / 0.4;
}

}  // namespace

// Droplets grow as the air thickens: q's classes (physics.md) run from air to fog with falling visibility.
double prior_q(double ln_sigma, const FitOptions& options) {
  return options.q_mean_fog + (options.q_mean_haze - options.q_mean_fog) * clearness(ln_sigma) +
         (options.q_mean_clear - options.q_mean_haze) * beyond_haze(ln_sigma);
}

double prior_q_sigma(double ln_sigma, const FitOptions& options) {
  return options.q_sigma + (options.q_sigma_clear - options.q_sigma) * beyond_haze(ln_sigma);
}

double soften(double r, double tail, double& slope) {
  const double c2 = tail * tail, s = r * r;
  if (s < 1e-12) {
    slope = 1.0;
    return r;
  }
  const double softened = std::sqrt(c2 * std::log1p(s / c2));
  slope = std::abs(r) / (1.0 + s / c2) / softened;
  return std::copysign(softened, r);
}

FrameCost::FrameCost(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options)
    : scene_(scene), halo_(halo), data_(data), options_(options), at_(scene.lamps().size()) {
  for (size_t r = 0; r < scene.ring_count(); ++r)
    if (data.used[r]) rings_.push_back(r);
  for (const SceneLamp& lamp : scene.lamps()) guests_ += lamp.guest() ? 1 : 0;
}

void FrameCost::evaluate(const double* p, double* residuals, double* jacobian) const {
  const std::span<const double> parameters(p, at_.size());
  scene_.evaluate(halo_, parameters, data_.lit, data_.sky_unit, output_, jacobian != nullptr);
  const size_t columns = at_.size();
  for (size_t i = 0; i < rings_.size(); ++i) {
    const size_t r = rings_[i];
    double slope = 0;
    residuals[i] = soften((output_.model[r] - data_.value[r]) / data_.sigma[r], options_.ring_tail, slope);
    if (!jacobian) continue;
    const double scale = slope / data_.sigma[r];
    const double* from = &output_.jacobian[r * columns];
    double* to = jacobian + i * columns;
    for (size_t c = 0; c < columns; ++c) to[c] = from[c] * scale;
  }
  priors(p, residuals, jacobian);
  guests(p, residuals, jacobian);
}

// What is seen of each guest's beam.
void FrameCost::guests(const double* p, double* residuals, double* jacobian) const {
  size_t row = residual_count() - guests_;
  for (size_t j = 0; j < at_.lamps; ++j) {
    const SceneLamp& lamp = scene_.lamps()[j];
    if (!lamp.guest()) continue;
    const double thickness =
        std::exp(p[Layout::ln_sigma] + p[at_.ln_distance(j)]) * lamp.distance_m.value_or(1.0);
    const double ln_beam = p[Layout::ln_gain] + lamp.ln_strength + p[at_.ln_strength(j)] - thickness;
    residuals[row] = (ln_beam - *lamp.ln_beam) / lamp.ln_beam_sigma;
    if (jacobian) {
      double* to = jacobian + row * at_.size();
      to[Layout::ln_gain] = to[at_.ln_strength(j)] = 1 / lamp.ln_beam_sigma;
      to[Layout::ln_sigma] = to[at_.ln_distance(j)] = -thickness / lamp.ln_beam_sigma;
    }
    ++row;
  }
}

void FrameCost::priors(const double* p, double* residuals, double* jacobian) const {
  const size_t columns = at_.size();
  size_t row = rings_.size();
  if (jacobian) std::fill(jacobian + row * columns, jacobian + residual_count() * columns, 0.0);
  const auto pull = [&](size_t parameter, double mean, double sigma, bool heavy_tail) {
    double slope = 1.0;
    double r = sigma > 0 ? (p[parameter] - mean) / sigma : 0.0;
    if (heavy_tail) r = soften(r, options_.prior_tail, slope);
    residuals[row] = r;
    if (jacobian && sigma > 0) jacobian[row * columns + parameter] = slope / sigma;
    ++row;
  };
  constexpr double kStep = 1e-4;
  const double ln_sigma = p[Layout::ln_sigma];
  const auto q_off = [&](double at) {
    return (p[Layout::q] - prior_q(at, options_)) / prior_q_sigma(at, options_);
  };
  if (jacobian)
    jacobian[row * columns + Layout::ln_sigma] =
        (q_off(ln_sigma + kStep) - q_off(ln_sigma - kStep)) / (2 * kStep);
  pull(Layout::q, prior_q(ln_sigma, options_), prior_q_sigma(ln_sigma, options_), false);
  pull(Layout::ln_gain, 0, options_.gain_known ? options_.ln_gain_sigma : kWideGainSigma,
       options_.gain_known);
  const double core = scene_.spread().core_ln_sigma;
  pull(Layout::ln_kappa, 0, options_.kappa_sigma > 0 ? options_.kappa_sigma : core, false);
  pull(Layout::emission, options_.emission_mean, options_.emission_sigma, false);
  pull(Layout::slope_x, 0, options_.slope_sigma, false);
  pull(Layout::slope_y, 0, options_.slope_sigma, false);
  for (size_t j = 0; j < at_.lamps; ++j) {
    const SceneLamp& lamp = scene_.lamps()[j];
    pull(at_.ln_strength(j), data_.ln_dimming.empty() ? 0 : data_.ln_dimming[j], lamp.ln_strength_sigma,
         true);
    pull(at_.ln_halo(j), 0, lamp.ln_halo_sigma, false);
    pull(at_.ln_distance(j), 0, lamp.distance_ln_sigma, false);
    pull(at_.sky(j), 1, kSkySigma, false);
  }
}

double cost_at(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
               const std::vector<double>& p) {
  const FrameCost cost(scene, halo, data, options);
  std::vector<double> residuals(cost.residual_count());
  cost.evaluate(p.data(), residuals.data(), nullptr);
  double sum = 0;
  for (const double r : residuals) sum += r * r / 2;
  return sum;
}

Residuals residuals_at(const Scene& scene, const HaloModel& halo, const RingData& data,
                       const FitOptions& options, std::span<const double> parameters) {
  const FrameCost cost(scene, halo, data, options);
  Residuals out;
  out.value.resize(cost.residual_count());
  out.jacobian.resize(cost.residual_count() * cost.parameter_count());
  cost.evaluate(parameters.data(), out.value.data(), out.jacobian.data());
  return out;
}

}  // namespace lampglow::inference
