#include "estimator/scattering/phase_function.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/quadrature.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;

// ∫ f(cos α) p dΩ by panels that crowd where forward scattering is.
template <typename F>
double over_sphere(const HenyeyGreenstein& phase, F&& f) {
  const auto& rule = GaussLegendre<16>::get();
  double sum = 0;
  constexpr int panels = 200;
  for (int panel = 0; panel < panels; ++panel)
    for (std::size_t i = 0; i < rule.node.size(); ++i) {
      const double half = 0.5 / panels, s = (2 * panel + 1 + rule.node[i]) * half;
      const double alpha = kPi * s * s, slope = 2 * kPi * s;
      const double versine = 2 * std::sin(alpha / 2) * std::sin(alpha / 2);
      sum += rule.weight[i] * half * slope * 2 * kPi * std::sin(alpha) * f(1 - versine) *
             phase.per_sr_from_one_minus_cos(versine);
    }
  return sum;
}

class PhaseFunction : public testing::TestWithParam<double> {};

TEST_P(PhaseFunction, IntegratesToOneWithMeanCosineQ) {
  const HenyeyGreenstein phase(GetParam());
  EXPECT_NEAR(over_sphere(phase, [](double) { return 1.0; }), 1, 1e-9);
  EXPECT_NEAR(over_sphere(phase, [](double x) { return x; }), GetParam(), 1e-9);
  EXPECT_NEAR(over_sphere(phase, [](double x) { return (3 * x * x - 1) / 2; }), GetParam() * GetParam(),
              1e-9);
}

TEST_P(PhaseFunction, SeriesIsTheClosedForm) {
  const HenyeyGreenstein phase(GetParam());
  for (const double x : {-1.0, -0.3, 0.2, 0.9, 1.0})
    EXPECT_NEAR(phase.per_sr_series(x, 1500) / phase.per_sr(x), 1, 1e-7) << x;
}

TEST_P(PhaseFunction, SamplerInvertsTheCumulative) {
  const HenyeyGreenstein phase(GetParam());
  for (int i = 0; i < 100; ++i) {
    const double u = 0.0005 + 0.01 * i;
    EXPECT_NEAR(phase.cumulative(phase.sample(u)), u, 1e-9);
  }
  EXPECT_NEAR(phase.cumulative(-1), 0, 1e-12);
  EXPECT_NEAR(phase.cumulative(1), 1, 1e-12);
}

TEST_P(PhaseFunction, DerivativeIsTheDifference) {
  const double q = GetParam(), h = 1e-6;
  for (const double versine : {0.0, 1e-4, 0.01, 0.5, 2.0}) {
    const double difference = (HenyeyGreenstein(q + h).per_sr_from_one_minus_cos(versine) -
                               HenyeyGreenstein(q - h).per_sr_from_one_minus_cos(versine)) /
                              (2 * h);
    EXPECT_NEAR(HenyeyGreenstein(q).derivative_q(versine), difference, 1e-6 * (std::abs(difference) + 1))
        << versine;
  }
}

INSTANTIATE_TEST_SUITE_P(OverQ, PhaseFunction, testing::Values(-0.5, 0.0, 1e-7, 0.3, 0.75, 0.9, 0.97));

TEST(PhaseFunctionLimits, RefusesQOfOneAndBeyond) {
  EXPECT_THROW(HenyeyGreenstein(1), std::invalid_argument);
  EXPECT_THROW(HenyeyGreenstein(-1.2), std::invalid_argument);
}

TEST(LegendrePolynomials, AreTheKnownOnes) {
  const auto p = legendre_polynomials(0.3, 4);
  EXPECT_DOUBLE_EQ(p[0], 1);
  EXPECT_DOUBLE_EQ(p[1], 0.3);
  EXPECT_NEAR(p[2], (3 * 0.09 - 1) / 2, 1e-15);
  EXPECT_NEAR(p[3], (5 * 0.027 - 3 * 0.3) / 2, 1e-15);
}

}  // namespace
}  // namespace lampglow::scattering
