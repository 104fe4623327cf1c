#include "estimator/scattering/glow_kernel.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/scattering/glow_table.h"

namespace lampglow::scattering {
namespace {
constexpr double kPi = std::numbers::pi;
constexpr std::size_t kKernelSamples = 1500;
}  // namespace

GlowKernel::GlowKernel(const RenderOptions& options, double distance_m)
    : focal_(options.focal_length_px), first_log_(0), step_(0) {
  const double thickness = options.medium.extinction_per_m * distance_m;
  const GlowTable& table = default_glow_table();
  first_log_ = std::log(table.domain().theta_min_rad);
  step_ = (std::log(table.domain().theta_max_rad) - first_log_) / static_cast<double>(kKernelSamples - 1);
  std::vector<double> theta(kKernelSamples), single(kKernelSamples), multiple(kKernelSamples);
  for (std::size_t i = 0; i < kKernelSamples; ++i)
    theta[i] = std::exp(first_log_ + step_ * static_cast<double>(i));
  table.parts(thickness, options.medium.q, options.medium.albedo, theta, single, multiple);
  const double scale = 4 * kPi * thickness * thickness / (focal_ * focal_);
  for (std::size_t i = 0; i < kKernelSamples; ++i)
    log_value_.push_back(std::log(theta[i] * scale * (single[i] + (options.single_only ? 0 : multiple[i]))));
}

double GlowKernel::at(double offset_px) const {
  const double theta = std::atan2(offset_px, focal_);
  const double position =
      std::clamp((std::log(theta) - first_log_) / step_, 0.0, static_cast<double>(kKernelSamples) - 1.0001);
  const auto i = static_cast<std::size_t>(position);
  const double value =
      log_value_[i] + (position - static_cast<double>(i)) * (log_value_[i + 1] - log_value_[i]);
  return std::exp(value) / theta;
}

double GlowKernel::pixel(double dx, double dy) const {
  if (dx == 0 && dy == 0) {
    // Polar about the lamp: at(r) r is smooth, and the pixel's edge lies at 0.5/cos φ within ±45°.
    double sum = 0;
    constexpr int turns = 16, steps = 16;
    for (int k = 0; k < turns; ++k) {
      const double edge = 0.5 / std::cos(kPi / 4 * (k + 0.5) / turns);
      for (int i = 0; i < steps; ++i) {
        const double r = edge * (i + 0.5) / steps;
        sum += at(r) * r * edge / steps;
      }
    }
    return sum * 2 * kPi / turns;
  }
  const double offset = std::hypot(dx, dy);
  if (offset > 12) return at(offset);
  const int fine = offset < 3 ? 16 : 4;
  double sum = 0;
  for (int i = 0; i < fine; ++i)
    for (int k = 0; k < fine; ++k)
      sum += at(std::hypot(dx + (i + 0.5) / fine - 0.5, dy + (k + 0.5) / fine - 0.5));
  return sum / (fine * fine);
}

}  // namespace lampglow::scattering
