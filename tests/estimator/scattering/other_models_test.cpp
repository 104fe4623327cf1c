// The lecture's other models: diffusion, the dipole, the APSF series, and the choice between models.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/apsf_series.h"
#include "estimator/scattering/diffusion.h"
#include "estimator/scattering/glow_model.h"
#include "estimator/scattering/phase_function.h"
#include "estimator/scattering/transfer_solution.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

void expect_derivatives(const std::function<GlowRadiance(double, double)>& model, double thickness,
                        double q) {
  const double h = 1e-6;
  const GlowRadiance at = model(thickness, q);
  const double d_t =
      (model(thickness * std::exp(h), q).value - model(thickness * std::exp(-h), q).value) / (2 * h);
  const double d_q = (model(thickness, q + h).value - model(thickness, q - h).value) / (2 * h);
  EXPECT_NEAR(at.d_ln_thickness, d_t, 1e-5 * (at.value + std::abs(d_t)));
  EXPECT_NEAR(at.d_q, d_q, 1e-5 * (at.value + std::abs(d_q)));
}

TEST(Diffusion, DerivativesAreTheDifferences) {
  for (const double theta : {0.01, 1.0, 2.0})
    for (const double albedo : {0.9, 1.0})
      expect_derivatives([&](double t, double q) { return diffusion_radiance(t, q, albedo, theta); }, 3, 0.8);
}

TEST(Diffusion, IsWhatTheTransferEquationBecomesFarAway) {
  for (const double q : {0.0, 0.5, 0.9}) {
    const TransferSolution solution(TransferKernel(q), 1.0);
    EXPECT_NEAR(solution.scattered_fluence_rate(60) / diffusion_fluence_rate(60, q, 1), 1, 1e-4) << q;
  }
  // Near the lamp it is not: isotropic scattering gives (π²/4)/(4πr) there, the transform of (atan k / k)² at
  // large k.
  const TransferSolution isotropic(TransferKernel(0), 1.0);
  EXPECT_NEAR(isotropic.scattered_fluence_rate(1e-3) * 4 * kPi * 1e-3, kPi * kPi / 4, 0.01);
}

TEST(Diffusion, FluxIsConserved) {
  // ω0 = 1: ∫ L cos θ dΩ = 1/(4πT²).
  double flux = 0;
  for (int i = 0; i < 3142; ++i) {  // up to π
    const double theta = 0.0005 + 0.001 * i;
    flux += 0.001 * 2 * kPi * std::sin(theta) * std::cos(theta) * diffusion_radiance(30, 0.5, 1, theta).value;
  }
  EXPECT_NEAR(flux * 4 * kPi * 900, 1, 1e-4);
}

TEST(Dipole, IntegratesToTheTotalDiffuseReflectance) {
  // Jensen 2001: R = α'/2 (1 + e^(-4/3 A √(3(1-α')))) e^(-√(3(1-α'))).
  const Medium medium{1000, 0.95, 0.8};
  const double scattering = 0.2 * 950, extinction = scattering + 50, albedo = scattering / extinction;
  double sum = 0;
  for (int i = 0; i < 22'000; ++i) {
    const double r = std::exp(-20 + 0.001 * i);
    sum += 0.001 * 2 * kPi * r * r * dipole_reflectance_per_m2(medium, 1, r);
  }
  const double root = std::sqrt(3 * (1 - albedo));
  EXPECT_NEAR(sum / (albedo / 2 * (1 + std::exp(-4 * root / 3)) * std::exp(-root)), 1, 1e-3);
}

// The published sum, written out anew with 2000 terms.
double published(double thickness, double q, double theta) {
  const auto g = [&](int m) {
    if (m == 0) return 0.0;
    const double beta = (2.0 * m + 1) / m * (1 - std::pow(q, m - 1));
    return std::exp(-beta * thickness - (m + 1) * std::log(thickness)) / (4 * kPi);
  };
  const auto legendre = legendre_polynomials(std::cos(theta), 2000);
  double sum = 0;
  for (int m = 0; m < 2000; ++m) sum += (g(m) + g(m + 1)) * legendre[static_cast<std::size_t>(m)];
  return sum;
}

TEST(ApsfSeries, IsThePublishedSumWithinItsStatedError) {
  for (const double thickness : {1.05, 1.2, 4.0})
    for (const double q : {0.0, 0.2, 0.9})  // at 0 β falls with m
      for (const double theta_deg : {0.0, 5.0, 60.0, 180.0})
        EXPECT_NEAR(apsf_series(thickness, q, theta_deg * kDegree, 1e-5).value,
                    published(thickness, q, theta_deg * kDegree), 1e-5 * published(thickness, q, 0));
}

TEST(ApsfSeries, IsNearlyFlatNearTheLamp) {
  // physics.md: at q = 0.9, T = 2 the series gives I(0.4°)/I(10°) = 1.02, the truth is 48.
  EXPECT_NEAR(apsf_series(2, 0.9, 0.4 * kDegree).value / apsf_series(2, 0.9, 10 * kDegree).value, 1.02,
              0.005);
}

TEST(ApsfSeries, RefusesThinAirWithTheReason) {
  EXPECT_THROW(apsf_series(1, 0.9, 0.1), std::domain_error);
  EXPECT_THROW(apsf_series(2, 1, 0.1), std::domain_error);
  try {
    apsf_series(0.8, 0.9, 0.1);
    FAIL();
  } catch (const std::domain_error& error) {
    EXPECT_NE(std::string(error.what()).find("converge"), std::string::npos) << error.what();
  }
}

TEST(ApsfSeries, DerivativesAreTheDifferences) {
  for (const double theta : {0.0, 0.2, 2.0})
    expect_derivatives([&](double t, double q) { return apsf_series(t, q, theta, 1e-9); }, 1.5, 0.8);
}

TEST(GlowModel, NamesGoThereAndBack) {
  for (const GlowModel model :
       {GlowModel::table, GlowModel::apsf_series, GlowModel::single, GlowModel::diffusion})
    EXPECT_EQ(parse_glow_model(to_string(model)), model);
  EXPECT_FALSE(parse_glow_model("tables"));
}

TEST(GlowModel, SaysWhatIsOutside) {
  const std::vector<double> theta{1 * kDegree};
  std::vector<double> out(1);
  EXPECT_EQ(outside_glow_model(GlowModel::single, 0.5, 0.8, 1, theta), "");
  EXPECT_NE(outside_glow_model(GlowModel::apsf_series, 0.5, 0.8, 1, theta).find("converges above 1"),
            std::string::npos);
  EXPECT_NE(outside_glow_model(GlowModel::single, 25, 0.8, 1, theta).find("25"), std::string::npos);
  EXPECT_THROW(glow_profile(GlowModel::single, 25, 0.8, 1, theta, out, out, out), std::domain_error);
  EXPECT_THROW(glow_profile(GlowModel::table, 25, 0.8, 1, theta, out, out, out), std::domain_error);
}

}  // namespace
}  // namespace lampglow::scattering
