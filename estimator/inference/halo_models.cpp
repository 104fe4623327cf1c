#include "estimator/inference/halo_models.h"

#include <cmath>
#include <numbers>

namespace lampglow::inference {
namespace {

constexpr std::string_view kNames[] = {"table", "apsf_series", "single", "diffusion"};

double single(double t, double q, double theta) {
  constexpr int kSteps = 48;
  const double pi = std::numbers::pi;
  double sum = 0;
  // α = π − (π−θ)(1−u²): dense near θ
  for (int i = 0; i < kSteps; ++i) {
    const double u = (i + 0.5) / kSteps;
    const double alpha = theta + (pi - theta) * u * u;
    const double jac = (pi - theta) * 2 * u / kSteps;
    const double d = t * std::sin(theta) / std::sin(alpha);
    const double s = t * std::sin(alpha - theta) / std::sin(alpha);
    const double phase = (1 - q * q) / std::pow(1 + q * q - 2 * q * std::cos(alpha), 1.5) / (4 * pi);
    sum += jac * phase * std::exp(-(s + d));
  }
  return sum / (4 * pi) / (t * std::sin(theta));
}

class Single final : public HaloModel {
 public:
  void profile(double t, double q, std::span<const double> theta, std::span<double> value,
               std::span<double> dt, std::span<double> dq) const override {
    for (size_t n = 0; n < theta.size(); ++n) {
      value[n] = single(t, q, theta[n]);
      dt[n] = (single(t * 1.001, q, theta[n]) - single(t * 0.999, q, theta[n])) /
              (std::log(1.001) - std::log(0.999));
      dq[n] = (single(t, q + 1e-4, theta[n]) - single(t, q - 1e-4, theta[n])) / 2e-4;
    }
  }
  double min_thickness() const override { return 0.001; }
  double max_thickness() const override { return 15; }
  double max_q() const override { return 0.96; }
};

}  // namespace

std::string_view to_string(HaloKind kind) {
  return kNames[static_cast<size_t>(kind)];
}

std::optional<HaloKind> parse_halo_kind(std::string_view text) {
  for (size_t i = 0; i < std::size(kNames); ++i)
    if (text == kNames[i]) return static_cast<HaloKind>(i);
  return std::nullopt;
}

std::shared_ptr<const HaloModel> halo_model(HaloKind) {
  return std::make_shared<const Single>();
}

}  // namespace lampglow::inference
