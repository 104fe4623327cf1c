#include "estimator/scattering/glow_table.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "estimator/scattering/glow_table_file.h"
#include "estimator/scattering/random.h"
#include "estimator/scattering/single_scattering.h"
#include "estimator/scattering/transfer_solution.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

struct Point {
  double total, d_ln_thickness, d_q;
};

Point at(double thickness, double q, double albedo, double theta) {
  Point point{};
  default_glow_table().profile(thickness, q, albedo, {&theta, 1}, {&point.total, 1},
                               {&point.d_ln_thickness, 1}, {&point.d_q, 1});
  return point;
}

TEST(GlowTable, CoversTheDomainItPromises) {
  const GlowDomain& domain = default_glow_table().domain();
  EXPECT_NEAR(domain.thickness_min, 0.01, 1e-12);
  EXPECT_NEAR(domain.thickness_max, 15, 1e-9);
  EXPECT_NEAR(domain.q_min, 0, 1e-12);
  EXPECT_NEAR(domain.q_max, 0.97, 1e-12);
  EXPECT_NEAR(domain.albedo_min, 0.8, 1e-12);
  EXPECT_NEAR(domain.albedo_max, 1, 1e-12);
  EXPECT_NEAR(domain.theta_min_rad, 0.01 * kDegree, 1e-12);
  EXPECT_NEAR(domain.theta_max_rad, 90 * kDegree, 1e-12);
  // The corners themselves, as a caller writes them.
  for (const double t : {0.01, 15.0})
    for (const double q : {0.0, 0.97})
      for (const double w : {0.8, 1.0})
        for (const double theta : {0.01, 90.0}) EXPECT_GT(at(t, q, w, theta * kDegree).total, 0);
}

TEST(GlowTable, IsTheSolutionBetweenItsNodes) {
  Random random(3);
  for (const double q : {0.13, 0.62, 0.957}) {
    const TransferKernel kernel(q);
    for (const double albedo : {0.83, 0.97, 1.0}) {
      const TransferSolution solution(kernel, albedo);
      for (int i = 0; i < 20; ++i) {
        const double thickness = 0.01 * std::pow(1500, random.uniform());
        const double theta = 0.01 * std::pow(9000, random.uniform()) * kDegree;
        const double truth =
            solution.multiple(thickness, theta) + single_scattering(thickness, q, albedo, theta).value;
        EXPECT_NEAR(at(thickness, q, albedo, theta).total / truth, 1, 5e-4)
            << "T " << thickness << " q " << q << " albedo " << albedo << " theta " << theta / kDegree;
      }
    }
  }
}

TEST(GlowTable, DerivativesAreTheDifferencesEverywhere) {
  Random random(5);
  const double h = 2e-5;
  for (int i = 0; i < 2000; ++i) {
    const double t = 0.0101 * std::pow(14.9 / 0.0101, random.uniform()), q = 0.001 + 0.968 * random.uniform();
    const double w = 0.8 + 0.2 * random.uniform(), theta = 0.01 * std::pow(9000, random.uniform()) * kDegree;
    const Point here = at(t, q, w, theta);
    const double d_t =
        (at(t * std::exp(h), q, w, theta).total - at(t * std::exp(-h), q, w, theta).total) / (2 * h);
    const double step = h * (1 - q);
    const double d_q = (at(t, q + step, w, theta).total - at(t, q - step, w, theta).total) / (2 * step);
    EXPECT_NEAR(here.d_ln_thickness, d_t, 1e-4 * std::abs(d_t) + 1e-8 * here.total)
        << t << " " << q << " " << theta;
    EXPECT_NEAR(here.d_q, d_q, 1e-4 * std::abs(d_q) + 1e-8 * here.total / (1 - q))
        << t << " " << q << " " << theta;
  }
}

TEST(GlowTable, ValueAndDerivativesAreContinuousAcrossNodes) {
  // Every node of ln T and of -ln(1-q), from both sides.
  const double tiny = 1e-9;
  for (int node = 1; node < 49; ++node) {
    const double t = 0.01 * std::pow(1500, node / 49.0);
    const Point below = at(t * (1 - tiny), 0.7, 0.95, 0.02), above = at(t * (1 + tiny), 0.7, 0.95, 0.02);
    EXPECT_NEAR(above.total / below.total, 1, 1e-6);
    EXPECT_NEAR(above.d_ln_thickness, below.d_ln_thickness, 1e-6 * below.total);
  }
  for (int node = 1; node < 20; ++node) {
    const double q = 1 - std::pow(0.03, node / 20.0);
    const Point below = at(2, q - tiny, 0.95, 0.02), above = at(2, q + tiny, 0.95, 0.02);
    EXPECT_NEAR(above.total / below.total, 1, 1e-6);
    EXPECT_NEAR(above.d_q, below.d_q, 1e-6 * below.total / (1 - q));
  }
}

TEST(GlowTable, OutsideIsAnErrorAndNoNumber) {
  const double theta = 0.1;
  double total = -7, d_t = -7, d_q = -7;
  const auto ask = [&](double t, double q, double w, double angle) {
    default_glow_table().profile(t, q, w, {&angle, 1}, {&total, 1}, {&d_t, 1}, {&d_q, 1});
  };
  EXPECT_THROW(ask(0.0099, 0.5, 1, theta), std::domain_error);
  EXPECT_THROW(ask(15.1, 0.5, 1, theta), std::domain_error);
  EXPECT_THROW(ask(1, 0.971, 1, theta), std::domain_error);
  EXPECT_THROW(ask(1, -0.01, 1, theta), std::domain_error);
  EXPECT_THROW(ask(1, 0.5, 0.79, theta), std::domain_error);
  EXPECT_THROW(ask(1, 0.5, 1.01, theta), std::domain_error);
  EXPECT_THROW(ask(1, 0.5, 1, 1.6), std::domain_error);
  EXPECT_THROW(ask(NAN, 0.5, 1, theta), std::domain_error);
  EXPECT_EQ(total, -7);
  EXPECT_FALSE(default_glow_table().domain().contains(15.1, 0.5, 1));
  EXPECT_TRUE(default_glow_table().domain().contains(15, 0.97, 1));
}

TEST(GlowTable, GivesAllValuesOfPhysicsMdOnceTheirBallOfFogIsCounted) {
  // Those photons were lost 25 mean free paths from the lamp. What would have come back from beyond is
  // diffuse and nearly even in the small sphere that matters: with U = (1/r - 1/(25 + λ))/(4πD) instead of
  // 1/(4πDr), D = 1/(3(1 - q)), λ = 0.7104/(1 - q), the radiance is less by 3(1 - q)/(16π² (25 + λ)). It is
  // closed form: neither table nor Monte Carlo has a part in it.
  const double theta_deg[] = {0.2, 0.5, 1, 2, 5, 10, 20, 40};
  struct Row {
    double q, t, value[8];
  };
  const std::vector<Row> rows = {
      {0.75, 0.5, {18.0, 7.26, 3.59, 1.73, 0.605, 0.225, 0.0643, 0.0150}},
      {0.75, 1.5, {2.32, 0.957, 0.496, 0.259, 0.105, 0.0461, 0.0166, 0.00509}},
      {0.75, 4, {0.0821, 0.0396, 0.0243, 0.0160, 0.00950, 0.00610, 0.00350, 0.00173}},
      {0.9, 0.5, {43.7, 17.1, 8.10, 3.52, 0.828, 0.188, 0.0326, 0.00549}},
      {0.9, 1.5, {5.78, 2.40, 1.23, 0.590, 0.172, 0.0481, 0.0101, 0.00191}},
      {0.9, 4, {0.226, 0.115, 0.0723, 0.0457, 0.0213, 0.00909, 0.00289, 0.000747}}};
  int below_infinite = 0;
  for (const Row& row : rows) {
    const double lost = 3 * (1 - row.q) / (16 * kPi * kPi * (25 + 0.7104 / (1 - row.q)));
    for (std::size_t i = 0; i < 8; ++i) {
      const double infinite = at(row.t, row.q, 1, theta_deg[i] * kDegree).total;
      EXPECT_NEAR((infinite - lost) / row.value[i], 1, 0.021) << row.q << " " << row.t << " " << theta_deg[i];
      below_infinite += infinite / row.value[i] > 1.02;
    }
  }
  EXPECT_EQ(below_infinite, 10);  // as docs/scattering.md says
}

TEST(TransferSolution, ConservesEnergy) {
  // ω0 = 1: net flux of direct, single and multiple light through any sphere is the lamp's whole, 1/(4πT²).
  for (const double q : {0.0, 0.8, 0.95}) {
    const TransferSolution solution(TransferKernel(q), 1);
    for (const double thickness : {0.1, 1.0, 8.0}) {
      double flux = direct_irradiance(thickness);
      const auto add = [&](double theta, double width) {
        const double radiance =
            solution.multiple(thickness, theta) + single_scattering(thickness, q, 1, theta).value;
        flux += width * 2 * kPi * std::sin(theta) * std::cos(theta) * radiance;
      };
      constexpr int steps = 150;
      for (int i = 0; i < steps; ++i) {
        const double step = 12.0 / steps, off = kPi / 2 * std::exp(-12 + step * (i + 0.5));
        add(off, step * off);
        add(kPi - off, step * off);
      }
      EXPECT_NEAR(flux * 4 * kPi * thickness * thickness, 1, 0.002) << q << " " << thickness;
    }
  }
}

TEST(GlowTableFile, RefusesWhatIsNotWhole) {
  GlowTableContents contents;
  for (SplineAxis& axis : contents.axes) axis.nodes = 4;
  contents.single.assign(6 * 6 * 6, 0.5f);
  contents.multiple.assign(6 * 6 * 6 * 6, 0.25f);
  const std::vector<std::byte> good = write_glow_table(contents);
  EXPECT_EQ(read_glow_table(good).multiple, contents.multiple);
  const auto reason = [](const std::vector<std::byte>& file) -> std::string {
    try {
      GlowTable::parse(file);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  };
  auto bad = good;
  bad[0] = std::byte{'X'};
  EXPECT_NE(reason(bad).find("magic"), std::string::npos);
  bad = good;
  bad[8] = std::byte{9};
  EXPECT_NE(reason(bad).find("version 9"), std::string::npos);
  bad = good;
  bad[good.size() / 2] ^= std::byte{1};
  EXPECT_NE(reason(bad).find("checksum"), std::string::npos);
  bad = good;
  bad.resize(good.size() - 5);
  EXPECT_NE(reason(bad).find("bytes"), std::string::npos);
  EXPECT_NE(reason({}).find("cut short"), std::string::npos);
}

TEST(GlowTableFile, ChecksumIsThatOfZip) {
  const std::string text = "123456789";
  EXPECT_EQ(crc32(std::as_bytes(std::span(text))), 0xcbf43926u);
}

}  // namespace
}  // namespace lampglow::scattering
