#include "estimator/scattering/single_scattering.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/phase_function.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

// The airlight integral of physics.md as it stands, in α with s and d, by the midpoint rule in ln(α - θ) and
// ln(π - α): another substitution and another rule than the code's.
double brute_force(double thickness, double q, double theta) {
  const HenyeyGreenstein phase(q);
  const auto integrand = [&](double alpha) {
    const double d = thickness * std::sin(theta) / std::sin(alpha);
    const double s = thickness * std::sin(alpha - theta) / std::sin(alpha);
    return phase.per_sr(std::cos(alpha)) * std::exp(-(s + d));
  };
  const double middle = theta + (kPi - theta) / 2;
  constexpr int steps = 400'000;
  double sum = 0;
  for (int i = 0; i < steps; ++i) {
    const double y = -30 * (i + 0.5) / steps, step = 30.0 / steps;
    const double off = (kPi - theta) / 2 * std::exp(y);
    sum += step * off * integrand(theta + off);
    if (off > 1e-9) sum += step * off * integrand(kPi - off);
  }
  EXPECT_GT(middle, theta);
  return sum / (4 * kPi * thickness * std::sin(theta));
}

TEST(SingleScattering, IsTheAirlightIntegral) {
  for (const double thickness : {1e-3, 0.3, 4.0, 20.0})
    for (const double q : {0.0, 0.8, 0.96})
      for (const double theta_deg : {0.01, 0.5, 20.0, 90.0, 170.0}) {
        const double expected = brute_force(thickness, q, theta_deg * kDegree);
        EXPECT_NEAR(single_scattering(thickness, q, 1, theta_deg * kDegree).value / expected, 1, 1e-5)
            << "T " << thickness << " q " << q << " theta " << theta_deg;
      }
}

TEST(SingleScattering, OfThinIsotropicAirIsTheAngleLeft) {
  // exp -> 1, p = 1/4π: the integral is (π - θ)/4π.
  const double thickness = 1e-8;
  for (const double theta : {0.001, 0.5, 1.5, 3.0})
    EXPECT_NEAR(single_scattering(thickness, 0, 0.5, theta).value * thickness * std::sin(theta) * 32 * kPi *
                    kPi / (kPi - theta),
                1, 1e-5);
}

TEST(SingleScattering, StraightBackIsTheOneDimensionalIntegral) {
  // θ = π: ∫ ω0 p(-1) e^(-(T+2s)) / (4π (T+s)²) ds.
  const double thickness = 0.7, q = 0.6;
  double sum = 0;
  for (int i = 0; i < 300'000; ++i) {
    const double s = (i + 0.5) * 1e-4;
    sum += 1e-4 * std::exp(-(thickness + 2 * s)) / ((thickness + s) * (thickness + s));
  }
  const double expected = HenyeyGreenstein(q).per_sr(-1) * sum / (4 * kPi);
  EXPECT_NEAR(single_scattering(thickness, q, 1, kPi).value / expected, 1, 1e-5);
}

TEST(SingleScattering, TakesAnyPhaseFunction) {
  const HenyeyGreenstein phase(0.9);
  for (const double theta : {0.001, 0.1, 1.0, 2.5})
    EXPECT_NEAR(single_scattering(
                    2, 0.9, theta, [&](double v) { return phase.per_sr_from_one_minus_cos(v); }, 0.1) /
                    single_scattering(2, 0.9, 0.9, theta).value,
                1, 1e-8);
}

TEST(SingleScattering, DerivativesAreTheDifferences) {
  for (const double thickness : {0.01, 1.0, 15.0})
    for (const double q : {0.05, 0.85, 0.96})
      for (const double theta : {0.0003, 0.1, 1.5}) {
        const GlowRadiance at = single_scattering(thickness, q, 0.9, theta);
        const double h = 1e-5;
        const double d_t = (single_scattering(thickness * std::exp(h), q, 0.9, theta).value -
                            single_scattering(thickness * std::exp(-h), q, 0.9, theta).value) /
                           (2 * h);
        const double d_q = (single_scattering(thickness, q + h, 0.9, theta).value -
                            single_scattering(thickness, q - h, 0.9, theta).value) /
                           (2 * h);
        EXPECT_NEAR(at.d_ln_thickness, d_t, 1e-6 * (at.value + std::abs(d_t)));
        EXPECT_NEAR(at.d_q, d_q, 1e-6 * (at.value + std::abs(d_q)));
      }
}

TEST(SingleScattering, RefusesWhatCannotBe) {
  EXPECT_THROW(single_scattering(0, 0.5, 1, 0.1), std::invalid_argument);
  EXPECT_THROW(single_scattering(1, 1, 1, 0.1), std::invalid_argument);
  EXPECT_THROW(single_scattering(1, 0.5, 2, 0.1), std::invalid_argument);
  EXPECT_THROW(single_scattering(1, 0.5, 1, 0), std::invalid_argument);
  EXPECT_THROW(single_scattering(1, 0.5, 1, 4), std::invalid_argument);
}

}  // namespace
}  // namespace lampglow::scattering
