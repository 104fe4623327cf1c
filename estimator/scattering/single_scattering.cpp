#include "estimator/scattering/single_scattering.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "estimator/scattering/phase_function.h"
#include "estimator/scattering/quadrature.h"

namespace lampglow::scattering {
namespace {

constexpr double kFourPi = 4 * std::numbers::pi;
constexpr double kPanel = 1.0;            // width in v; with 8 nodes good to 1e-10
constexpr int kFewestPanels = 14;         // for the exponential's forty e-foldings, where it is steep
constexpr double kNegligible = 40;        // e^-40: where the exponential ends the integral
constexpr double kNearlyBackward = 1e-7;  // θ = 180° is taken this far from it: relative error 1e-7

void refuse(const char* what, double value, const char* constraint) {
  throw std::invalid_argument(std::string("single scattering: ") + what + " = " + std::to_string(value) +
                              ", must be " + constraint);
}

void check(double thickness, double albedo, double theta_rad) {
  if (!(thickness > 0 && std::isfinite(thickness))) refuse("thickness", thickness, "positive");
  if (!(albedo >= 0 && albedo <= 1)) refuse("albedo", albedo, "within 0..1");
  if (!(theta_rad > 0 && theta_rad <= std::numbers::pi))
    refuse("theta_rad", theta_rad, "above 0 and at most pi");
}

// Sums f(t, e^(-a(t-t0)) 2/(1+t²) dt) over t = scale sinh v from t0 upward.
template <typename Visit>
void integrate(double thickness, double theta_rad, double scale, Visit&& visit) {
  const auto& rule = GaussLegendre<8>::get();
  const double theta = std::min(theta_rad, std::numbers::pi - kNearlyBackward);
  const double rate = thickness * std::sin(theta), t0 = std::tan(theta / 2);
  const double v0 = std::asinh(t0 / scale);
  // Beyond t the rest is at most 1/t of the whole without the exponential.
  const double t_end = t0 + std::min(kNegligible / rate, 1e11 * (1 + t0));
  const double v_end = std::asinh(t_end / scale);
  const auto panels = std::max(kFewestPanels, static_cast<int>(std::ceil((v_end - v0) / kPanel)));
  const double half = (v_end - v0) / (2 * panels);
  for (int panel = 0; panel < panels; ++panel)
    for (std::size_t i = 0; i < rule.node.size(); ++i) {
      const double v = v0 + half * (2 * panel + 1 + rule.node[i]);
      const double exp_v = std::exp(v);
      const double t = scale * (exp_v - 1 / exp_v) / 2;
      const double dt = scale * (exp_v + 1 / exp_v) / 2 * half * rule.weight[i];
      visit(t, t - t0, std::exp(-rate * (t - t0)) * 2 / (1 + t * t) * dt);
    }
}

double one_minus_cos(double t) {
  return 2 * t * t / (1 + t * t);
}

double front_factor(double thickness, double albedo, double theta_rad) {
  const double theta = std::min(theta_rad, std::numbers::pi - kNearlyBackward);
  return albedo * std::exp(-thickness) / (kFourPi * thickness * std::sin(theta));
}

}  // namespace

GlowRadiance single_scattering(double thickness, double q, double albedo, double theta_rad) {
  check(thickness, albedo, theta_rad);
  const HenyeyGreenstein phase(q);
  const double theta = std::min(theta_rad, std::numbers::pi - kNearlyBackward);
  const double rate = thickness * std::sin(theta);
  double sum = 0, sum_rate = 0, sum_q = 0;
  // For q < 0 the narrow side is at the back, where t is large and its logarithm is the natural variable
  // anyway.
  integrate(thickness, theta, std::min(1.0, (1 - q) / (1 + q)), [&](double t, double beyond, double weight) {
    const double p = phase.per_sr_from_one_minus_cos(one_minus_cos(t));
    sum += p * weight;
    sum_rate += p * weight * beyond;
    sum_q += phase.derivative_q(one_minus_cos(t)) * weight;
  });
  const double front = front_factor(thickness, albedo, theta);
  return {front * sum, front * (-(thickness + 1) * sum - rate * sum_rate), front * sum_q};
}

double single_scattering(double thickness, double albedo, double theta_rad,
                         const std::function<double(double)>& phase_per_sr, double narrowest_rad) {
  check(thickness, albedo, theta_rad);
  if (!(narrowest_rad > 0)) refuse("narrowest_rad", narrowest_rad, "positive");
  double sum = 0;
  integrate(thickness, theta_rad, std::min(1.0, narrowest_rad / 2),
            [&](double t, double, double weight) { sum += phase_per_sr(one_minus_cos(t)) * weight; });
  return front_factor(thickness, albedo, theta_rad) * sum;
}

}  // namespace lampglow::scattering
