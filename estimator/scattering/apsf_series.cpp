#include "estimator/scattering/apsf_series.h"

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

namespace lampglow::scattering {
namespace {

constexpr int kMaxTerms = 1'000'000;

void check(double thickness, double q) {
  if (!(thickness > 1))
    throw std::domain_error(
        "APSF series: optical thickness = " + std::to_string(thickness) +
        ", must be above 1: its terms go as T^-(m+1) and the series does not converge otherwise");
  if (!(q >= 0 && q < 1))
    throw std::domain_error("APSF series: q = " + std::to_string(q) + ", must be in 0..1");
}

// g_m for I0 = 1/4π with its derivatives. q^0 = 1 also for q = 0.
GlowRadiance term(int m, double thickness, double q) {
  if (m == 0) return {};
  const double order = m, alpha = order + 1;
  const double beta = (2 * order + 1) / order * (1 - std::pow(q, order - 1));
  const double beta_q = m == 1 ? 0 : -(2 * order + 1) / order * (order - 1) * std::pow(q, order - 2);
  const double value = std::exp(-beta * thickness - alpha * std::log(thickness)) / (4 * std::numbers::pi);
  return {value, value * (-beta * thickness - alpha), -value * thickness * beta_q};
}

}  // namespace

int apsf_series_terms(double thickness, double q, double relative_error) {
  check(thickness, q);
  // |L_m| <= 1. Beyond m the factor 1 - q^(m-1) of β rises and (2m+1)/m falls by less than 1/m, so that
  // g_(m+k) <= g_m e^(T/m) / T^k: what is left after m is at most 2 g_m e^(T/m) T/(T-1).
  const double whole = term(1, thickness, q).value;
  for (int m = 1; m < kMaxTerms; ++m)
    if (2 * term(m, thickness, q).value * std::exp(thickness / m) * thickness / (thickness - 1) <
        relative_error * whole)
      return m + 1;
  throw std::domain_error("APSF series: optical thickness = " + std::to_string(thickness) +
                          " is so near 1 that a million terms do not give the relative error asked for");
}

GlowRadiance apsf_series(double thickness, double q, double theta_rad, double relative_error) {
  GlowRadiance radiance;
  apsf_series(thickness, q, {&theta_rad, 1}, {&radiance, 1}, relative_error);
  return radiance;
}

void apsf_series(double thickness, double q, std::span<const double> theta_rad, std::span<GlowRadiance> out,
                 double relative_error) {
  const int terms = apsf_series_terms(thickness, q, relative_error);
  std::vector<GlowRadiance> coefficients;  // g_m + g_(m+1)
  GlowRadiance here = term(0, thickness, q);
  for (int m = 0; m < terms; ++m) {
    const GlowRadiance next = term(m + 1, thickness, q);
    coefficients.push_back(
        {here.value + next.value, here.d_ln_thickness + next.d_ln_thickness, here.d_q + next.d_q});
    here = next;
  }
  for (std::size_t i = 0; i < theta_rad.size(); ++i) {
    const double mu = std::cos(theta_rad[i]);
    GlowRadiance sum;
    double polynomial = 1, before = 0;
    for (int m = 0; m < terms; ++m) {
      const GlowRadiance& coefficient = coefficients[static_cast<std::size_t>(m)];
      sum.value += coefficient.value * polynomial;
      sum.d_ln_thickness += coefficient.d_ln_thickness * polynomial;
      sum.d_q += coefficient.d_q * polynomial;
      const double above = ((2 * m + 1) * mu * polynomial - m * before) / (m + 1);
      before = polynomial;
      polynomial = above;
    }
    out[i] = sum;
  }
}

}  // namespace lampglow::scattering
