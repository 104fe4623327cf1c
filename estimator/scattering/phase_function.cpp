#include "estimator/scattering/phase_function.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

namespace lampglow::scattering {
namespace {
constexpr double kFourPi = 4 * std::numbers::pi;
// Below this |q| the closed inverse divides by q; the first order of q is exact to 1e-12.
constexpr double kNearlyIsotropic = 1e-6;
}  // namespace

HenyeyGreenstein::HenyeyGreenstein(double q) : q_(q) {
  if (!(std::abs(q) < 1))
    throw std::invalid_argument("Henyey-Greenstein: q = " + std::to_string(q) + ", must be between -1 and 1");
}

double HenyeyGreenstein::per_sr(double cos_alpha) const {
  return per_sr_from_one_minus_cos(1 - cos_alpha);
}

double HenyeyGreenstein::per_sr_from_one_minus_cos(double one_minus_cos_alpha) const {
  const double base = (1 - q_) * (1 - q_) + 2 * q_ * one_minus_cos_alpha;
  return (1 - q_ * q_) / (kFourPi * base * std::sqrt(base));
}

double HenyeyGreenstein::derivative_q(double one_minus_cos_alpha) const {
  const double base = (1 - q_) * (1 - q_) + 2 * q_ * one_minus_cos_alpha;
  const double base_q = 2 * (q_ - 1) + 2 * one_minus_cos_alpha;
  const double power = 1 / (base * std::sqrt(base));
  return (-2 * q_ * power - 1.5 * (1 - q_ * q_) * base_q * power / base) / kFourPi;
}

std::vector<double> HenyeyGreenstein::legendre(int count) const {
  std::vector<double> coefficients(static_cast<size_t>(std::max(count, 0)));
  double power = 1;
  for (double& coefficient : coefficients) {
    coefficient = power;
    power *= q_;
  }
  return coefficients;
}

double HenyeyGreenstein::per_sr_series(double cos_alpha, int count) const {
  const std::vector<double> coefficients = legendre(count);
  const std::vector<double> polynomials = legendre_polynomials(cos_alpha, count);
  double sum = 0;
  for (size_t m = 0; m < coefficients.size(); ++m)
    sum += (2 * static_cast<double>(m) + 1) * coefficients[m] * polynomials[m];
  return sum / kFourPi;
}

double HenyeyGreenstein::cumulative(double cos_alpha) const {
  if (std::abs(q_) < kNearlyIsotropic) return (1 + cos_alpha) / 2 + q_ * 0.75 * (cos_alpha * cos_alpha - 1);
  const double root = std::sqrt(1 + q_ * q_ - 2 * q_ * cos_alpha);
  return (1 - q_ * q_) / (2 * q_) * (1 / root - 1 / (1 + q_));
}

double HenyeyGreenstein::sample(double uniform) const {
  if (std::abs(q_) < kNearlyIsotropic) {
    const double x = 2 * uniform - 1;
    return std::clamp(x + 1.5 * q_ * (1 - x * x), -1.0, 1.0);
  }
  const double fraction = (1 - q_ * q_) / (1 - q_ + 2 * q_ * uniform);
  return std::clamp((1 + q_ * q_ - fraction * fraction) / (2 * q_), -1.0, 1.0);
}

std::vector<double> legendre_polynomials(double x, int count) {
  std::vector<double> values(static_cast<size_t>(std::max(count, 0)));
  for (size_t m = 0; m < values.size(); ++m) {
    const double order = static_cast<double>(m);
    if (m == 0)
      values[m] = 1;
    else if (m == 1)
      values[m] = x;
    else
      values[m] = ((2 * order - 1) * x * values[m - 1] - (order - 1) * values[m - 2]) / order;
  }
  return values;
}

}  // namespace lampglow::scattering
