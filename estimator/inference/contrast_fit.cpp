#include "estimator/inference/contrast_fit.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace lampglow::inference {
namespace {

// A target's brightness ratio, ready for the fit.
struct Brightness {
  double ratio = 1, noise = 0;
  double distance_m = 0, distance_rel_sigma = 0;
  double r0 = 0, r0_sigma = 0;
  bool learned = false;  // r0 is the target's own: the common prior error is not its
  double inflation = 1;  // of its variance, by the robust weights
};

// A target's texture, ready for the fit.
struct Texture {
  double log_energy = 0, noise_energy = 0, floor_energy = 0;
  double log_contrast = 0, sigma = 0;
  double distance_m = 0;
  std::array<double, 2> lighting{};
};

double square(double x) {
  return x * x;
}

std::vector<Brightness> brightness_of(const DayView& view, const Site& site,
                                      const ContrastFitOptions& options) {
  std::vector<Brightness> used;
  for (size_t i = 0; i < site.targets.size(); ++i) {
    const Target& target = site.targets[i];
    const TargetView& seen = view.targets[i];
    if (target.contrast || !target.distance_m || !seen.brightness_ratio) continue;
    Brightness b;
    b.ratio = *seen.brightness_ratio;
    b.noise = std::max(seen.brightness_ratio_sigma, 5e-4);
    b.distance_m = *target.distance_m;
    b.distance_rel_sigma = target.distance_sigma_m.value_or(0) / b.distance_m;
    b.learned = target.brightness_ratio.has_value();
    b.r0 = target.brightness_ratio.value_or(options.brightness_ratio);
    b.r0_sigma = b.learned ? target.brightness_ratio_sigma.value_or(options.brightness_ratio_sigma)
                           : options.brightness_ratio_sigma;
    if (options.snow) b.learned = false, b.r0 = options.snow_ratio, b.r0_sigma = options.snow_ratio_sigma;
    used.push_back(b);
  }
  return used;
}

std::vector<Texture> textures_of(const DayView& view, const Site& site) {
  std::vector<Texture> used;
  for (size_t i = 0; i < site.targets.size(); ++i) {
    const Target& target = site.targets[i];
    const TargetView& seen = view.targets[i];
    if (!target.contrast || !target.distance_m || seen.gradient_energy <= 0) continue;
    Texture t;
    t.log_energy = std::log(seen.gradient_energy);
    t.noise_energy = seen.noise_energy;
    t.floor_energy = std::exp(2 * (target.contrast->log_contrast + target.contrast->log_floor));
    t.log_contrast = target.contrast->log_contrast;
    t.sigma = target.contrast->log_contrast_sigma;
    t.distance_m = *target.distance_m;
    t.lighting = target.contrast->lighting;
    used.push_back(t);
  }
  return used;
}

// −ln probability of the brightness ratios at σ. Intrinsic brightness, airlight, unevenness of the haze and a
// veil before the lens are integrated out: in the neighbourhood of their priors the model is linear in them,
// so the ratios are jointly normal with covariance D + Σ cᵢ cᵢᵀ (D diagonal; c what is common to all targets:
// intrinsic brightness, airlight, veil).
struct BrightnessFit {
  double minus_ln_probability = 0;
  std::vector<double> z;  // residual over its marginal standard deviation
};

BrightnessFit fit_brightness(const std::vector<Brightness>& used, double sigma, const ContrastFitOptions& o) {
  BrightnessFit fit;
  Eigen::Matrix3d common = Eigen::Matrix3d::Identity();  // I + Cᵀ D⁻¹ C
  Eigen::Vector3d with_residual = Eigen::Vector3d::Zero();
  double rr = 0, ln_det = 0;
  for (const Brightness& b : used) {
    const double tau = sigma * b.distance_m, t = std::exp(-tau);
    const double model = airlight_ratio(b.r0, t), residual = b.ratio - model;
    const double by_haze = (1 - b.r0) * t * tau;  // ∂ratio/∂ln τ
    const double d = b.inflation * (square(b.noise) + square(t * b.r0_sigma) +
                                    square(o.airlight_sigma * model) + square(o.veil_sigma * (1 - model)) +
                                    square(by_haze) * (square(o.haze_sigma) + square(b.distance_rel_sigma)));
    const Eigen::Vector3d c(
        b.learned ? 0.0 : t * (o.snow ? o.snow_ratio_sigma : o.brightness_ratio_common_sigma),
        model * o.airlight_common_sigma, (1 - model) * o.veil_common_sigma);
    common += c * c.transpose() / d;
    with_residual += c * residual / d;
    rr += residual * residual / d;
    ln_det += std::log(d);
    fit.z.push_back(residual / std::sqrt(d + c.squaredNorm()));
  }
  // Woodbury.
  const double explained = with_residual.dot(common.inverse() * with_residual);
  fit.minus_ln_probability = 0.5 * (rr - explained + ln_det + std::log(common.determinant()));
  return fit;
}

// −ln probability of the textures at σ with the lighting factors at their best (Cauchy loss, Gauss-Newton
// from `lighting`, which is left at the best).
double fit_textures(const std::vector<Texture>& used, double sigma, double weight,
                    const ContrastFitOptions& o, std::array<double, 2>& lighting) {
  const double c2 = square(o.outlier_z), prior = 1 / square(o.lighting_sigma);
  double cost = 0;
  for (int iteration = 0; iteration < 12; ++iteration) {
    double h00 = prior, h11 = prior, h01 = 0, g0 = -lighting[0] * prior, g1 = -lighting[1] * prior;
    cost = 0.5 * prior * (square(lighting[0]) + square(lighting[1]));
    for (const Texture& t : used) {
      const double u =
          t.log_contrast + t.lighting[0] * lighting[0] + t.lighting[1] * lighting[1] - sigma * t.distance_m;
      const double model = log_gradient_energy(u, t.floor_energy, t.noise_energy);
      const double slope = gradient_energy_slope(u, model);
      const double s = 2 * t.sigma, z = (t.log_energy - model) / s;
      cost += weight * 0.5 * c2 * std::log1p(z * z / c2);
      const double w = weight / (1 + z * z / c2) / (s * s);
      const double j0 = slope * t.lighting[0], j1 = slope * t.lighting[1];
      h00 += w * j0 * j0, h11 += w * j1 * j1, h01 += w * j0 * j1;
      g0 += w * j0 * (t.log_energy - model), g1 += w * j1 * (t.log_energy - model);
    }
    const double det = h00 * h11 - h01 * h01;
    const double d0 = (h11 * g0 - h01 * g1) / det, d1 = (h00 * g1 - h01 * g0) / det;
    lighting[0] += std::clamp(d0, -1.0, 1.0);
    lighting[1] += std::clamp(d1, -1.0, 1.0);
    if (std::abs(d0) + std::abs(d1) < 1e-4) break;
  }
  return cost;
}

}  // namespace

double log_gradient_energy(double log_contrast, double floor_energy, double noise_energy) {
  return std::log(std::exp(2 * log_contrast) + floor_energy + noise_energy);
}

double gradient_energy_slope(double log_contrast, double log_energy) {
  return 2 * std::exp(2 * log_contrast - log_energy);
}

ContrastFit fit_contrast(const DayView& view, const Site& site, const ContrastFitOptions& options) {
  std::vector<Brightness> brightness = brightness_of(view, site, options);
  const std::vector<Texture> textures = textures_of(view, site);
  ContrastFit fit;
  fit.brightness_targets = static_cast<int>(brightness.size());
  fit.contrast_targets = static_cast<int>(textures.size());
  if (brightness.empty() && textures.empty()) return fit;

  const double low = std::log(kMorTimesExtinction / options.mor_most_m);
  const double high = std::log(kMorTimesExtinction / options.mor_least_m);
  const double step = (high - low) / (options.points - 1);
  const double independent = site.day ? site.day->independent_targets : 1.0;
  const double weight =
      textures.empty() ? 0.0 : std::min(1.0, independent / static_cast<double>(textures.size()));

  // Textures once; brightness again with outliers weighed down by their residual at the best σ so far.
  std::vector<double> texture_cost(static_cast<size_t>(options.points), 0.0);
  std::vector<std::array<double, 2>> lightings(texture_cost.size());
  std::array<double, 2> lighting{};
  for (size_t i = texture_cost.size(); i-- > 0;) {  // from fog to clear: in fog the lighting matters least
    texture_cost[i] =
        fit_textures(textures, std::exp(low + step * static_cast<double>(i)), weight, options, lighting);
    lightings[i] = lighting;
  }
  size_t best = 0;
  for (int round = 0; round < 3; ++round) {
    fit.posterior.clear();
    for (size_t i = 0; i < texture_cost.size(); ++i) {
      const double ln_sigma = low + step * static_cast<double>(i);
      fit.posterior.push_back(
          {ln_sigma,
           texture_cost[i] + fit_brightness(brightness, std::exp(ln_sigma), options).minus_ln_probability, 0,
           0});
    }
    best = static_cast<size_t>(std::min_element(fit.posterior.begin(), fit.posterior.end(),
                                                [](const auto& a, const auto& b) {
                                                  return a.minus_ln_probability < b.minus_ln_probability;
                                                }) -
                               fit.posterior.begin());
    if (brightness.size() < 3) break;
    const BrightnessFit at_best = fit_brightness(brightness, std::exp(fit.posterior[best].ln_sigma), options);
    if (round == 0)
      for (const double z : at_best.z) fit.worst_z = std::max(fit.worst_z, std::abs(z));
    for (size_t i = 0; i < brightness.size(); ++i)
      brightness[i].inflation *= 1 + square(at_best.z[i]) / square(options.outlier_z) > 2
                                     ? square(at_best.z[i] / options.outlier_z)
                                     : 1.0;
  }
  fit.lighting = lightings[best];
  return fit;
}

}  // namespace lampglow::inference
