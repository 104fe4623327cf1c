#include "estimator/scattering/diffusion.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace lampglow::scattering {
namespace {

constexpr double kFourPi = 4 * std::numbers::pi;

void check(double thickness, double q, double albedo) {
  if (!(thickness > 0)) throw std::invalid_argument("diffusion: thickness must be positive");
  if (!(std::abs(q) < 1)) throw std::invalid_argument("diffusion: q must be between -1 and 1");
  if (!(albedo > 0 && albedo <= 1)) throw std::invalid_argument("diffusion: albedo must be in (0, 1]");
}

}  // namespace

double diffusion_fluence_rate(double thickness, double q, double albedo) {
  check(thickness, q, albedo);
  const double transport = 1 - albedo * q;
  const double kappa = std::sqrt(3 * (1 - albedo) * transport);
  return 3 * transport * std::exp(-kappa * thickness) / (kFourPi * thickness);
}

GlowRadiance diffusion_radiance(double thickness, double q, double albedo, double theta_rad) {
  const double fluence = diffusion_fluence_rate(thickness, q, albedo);
  const double transport = 1 - albedo * q, kappa = std::sqrt(3 * (1 - albedo) * transport);
  const double depth = kappa * thickness;
  // 3F/U = (1 + κT)/(T (1 - ω0 q)).
  const double slope = (1 + depth) / (thickness * transport);
  const double shape = 1 + slope * std::cos(theta_rad);
  if (shape <= 0) return {};
  const double value = fluence * shape / kFourPi;
  // U ~ e^(-κT)/T; d slope/d ln T = -1/(T (1 - ω0 q)).
  const double d_ln_thickness =
      -(1 + depth) * value - fluence / kFourPi * std::cos(theta_rad) / (thickness * transport);
  // With x = 1 - ω0 q, dx/dq = -ω0: dU/dx = U (1/x - κT/(2x)), d slope/dx = (κT/2 - 1 - κT)/(T x²).
  const double fluence_x = fluence * (1 - depth / 2) / transport;
  const double slope_x = -(1 + depth / 2) / (thickness * transport * transport);
  const double d_q = -albedo * (fluence_x * shape + fluence * slope_x * std::cos(theta_rad)) / kFourPi;
  return {value, d_ln_thickness, d_q};
}

double dipole_reflectance_per_m2(const Medium& medium, double relative_index, double radius_m) {
  check(medium);
  if (!(relative_index >= 1 && relative_index <= 2))
    throw std::invalid_argument("dipole: relative_index must be within 1..2");
  if (!(radius_m >= 0)) throw std::invalid_argument("dipole: radius_m must not be negative");
  const double eta = relative_index;
  const double reduced_scattering = (1 - medium.q) * medium.scattering_per_m();
  const double reduced_extinction = medium.absorption_per_m() + reduced_scattering;
  const double reduced_albedo = reduced_scattering / reduced_extinction;
  const double kappa = std::sqrt(3 * medium.absorption_per_m() * reduced_extinction);
  // Fresnel's internal diffuse reflection as Jensen's rational fit, eq. 2; none for equal indices.
  const double fresnel = eta == 1 ? 0 : -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
  const double boundary = (1 + fresnel) / (1 - fresnel);
  const double depth_real = 1 / reduced_extinction;
  const double depth_virtual = depth_real * (1 + 4 * boundary / 3);
  const auto source = [&](double depth) {
    const double distance = std::hypot(radius_m, depth);
    return depth * (kappa * distance + 1) * std::exp(-kappa * distance) / (distance * distance * distance);
  };
  return reduced_albedo / kFourPi * (source(depth_real) + source(depth_virtual));
}

}  // namespace lampglow::scattering
