// The glow table against fresh photons, and the speeds that were promised.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "estimator/scattering/collision_monte_carlo.h"
#include "estimator/scattering/glow_renderer.h"
#include "estimator/scattering/glow_table.h"
#include "estimator/scattering/glow_table_builder.h"
#include "estimator/scattering/monte_carlo.h"
#include "estimator/scattering/quadrature.h"
#include "estimator/scattering/random.h"
#include "estimator/scattering/single_scattering.h"

namespace lampglow::scattering {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

void on_two_threads(std::size_t count, const std::function<void(std::size_t)>& task) {
  std::jthread even([&] {
    for (std::size_t i = 0; i < count; i += 2) task(i);
  });
  for (std::size_t i = 1; i < count; i += 2) task(i);
}

struct Parts {
  double single, multiple;
};

// Means over the ring's solid angle, as photons are counted: exact single scattering, the table's multiple.
Parts ring_mean(double thickness, double q, double albedo, double inner, double outer) {
  const auto& rule = GaussLegendre<8>::get();
  Parts mean{0, 0};
  double whole = 0;
  for (std::size_t i = 0; i < rule.node.size(); ++i) {
    const double theta = (inner + outer) / 2 + (outer - inner) / 2 * rule.node[i];
    const double weight = rule.weight[i] * std::sin(theta);
    double single = 0, multiple = 0;
    default_glow_table().parts(thickness, q, albedo, {&theta, 1}, {&single, 1}, {&multiple, 1});
    const double exact = single_scattering(thickness, q, albedo, theta).value;
    EXPECT_NEAR(single / exact, 1, 5e-4);
    mean.single += weight * exact;
    mean.multiple += weight * multiple;
    whole += weight;
  }
  return {mean.single / whole, mean.multiple / whole};
}

// A point of the table beside what photons say of it: deviation and one standard deviation of the photons,
// relative to the total.
struct Check {
  double thickness, q, albedo, inner, outer;
  double deviation, sigma;
};

void set(Check& check, const Estimate& multiple) {
  const Parts table = ring_mean(check.thickness, check.q, check.albedo, check.inner, check.outer);
  const double total = table.single + table.multiple;
  check.deviation = (table.multiple - multiple.value) / total;
  check.sigma = multiple.sigma / total;
}

// Where few photons cross a tiny ring their number is a small Poisson variable and their spread says little
// about its error; there every collision is counted instead.
// The table's own interpolation and the rings' quadrature, see docs/glow-table.md.
constexpr double kTable = 5e-4;
constexpr double kKnownByCrossings = 0.005, kEnoughCrossings = 0.05, kKnownByCollisions = 0.0075;

void count_collisions(Check& check, std::uint64_t seed) {
  CollisionPhotons run;
  run.q = check.q;
  run.albedo = check.albedo;
  run.thickness = check.thickness;
  run.rings = {{check.inner, check.outer}};
  run.photons_per_round = 6400;
  run.max_rounds = 2000;
  run.relative_error = kKnownByCollisions;
  run.seed = seed;
  set(check, simulate_collisions(run, on_two_threads).multiple[0]);
}

// 20 points of one q: 5 T, 2 albedos, 2 rings of ±25 % each.
void check_one_q(Random& random, std::uint64_t seed, std::vector<Check>& checks) {
  GlowPhotons run;
  run.q = 0.96 * random.uniform();
  run.albedos = {1 - 0.2 * random.uniform(), 1 - 0.2 * random.uniform()};
  for (int i = 0; i < 5; ++i) run.thicknesses.push_back(0.02 * std::pow(600, random.uniform()));
  std::sort(run.thicknesses.begin(), run.thicknesses.end());
  // Two rings that do not overlap, from one half of the logarithmic range each.
  for (const double from : {0.07, 2.0}) {
    const double theta = from * std::pow(16, random.uniform()) * kDegree;
    run.theta_edges_rad.push_back(theta * 0.75);
    run.theta_edges_rad.push_back(theta * 1.25);
  }
  if (run.theta_edges_rad[2] < run.theta_edges_rad[1]) run.theta_edges_rad[2] = run.theta_edges_rad[1];
  run.photons = 500'000;
  run.seed = seed;
  const GlowEstimate glow = simulate_glow(run, on_two_threads);
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t t = 0; t < 5; ++t)
      for (const std::size_t b : {0, 2}) {
        Check check{run.thicknesses[t],
                    run.q,
                    run.albedos[a],
                    run.theta_edges_rad[b],
                    run.theta_edges_rad[b + 1],
                    0,
                    0};
        const Estimate multiple = glow.multiple(a, t, b);
        set(check, multiple);
        // No photon, or one of tiny weight, has a tiny spread: their number must be large, too.
        if (!(check.sigma < kKnownByCrossings && multiple.sigma < kEnoughCrossings * multiple.value))
          count_collisions(check, seed);
        checks.push_back(check);
      }
}

struct Summary {
  std::size_t within_close = 0;  // 1.5 %
  double worst = 0, least_known = 0, squares = 0;
};

Summary summarize(const std::vector<Check>& checks) {
  Summary summary;
  for (const Check& check : checks) {
    const double off = std::abs(check.deviation);
    EXPECT_LT(off, 0.04) << "T " << check.thickness << " q " << check.q << " albedo " << check.albedo
                         << " theta " << check.inner / kDegree << ".." << check.outer / kDegree
                         << " deg, known to " << check.sigma;
    summary.within_close += off < 0.015;
    summary.worst = std::max(summary.worst, off);
    summary.least_known = std::max(summary.least_known, check.sigma);
    summary.squares +=
        off * off / (check.sigma * check.sigma + kTable * kTable) / static_cast<double>(checks.size());
  }
  std::printf(
      "%zu points, all known to %.2f %%: %.1f %% within 1.5 %%, worst %.2f %%; mean squared deviation in "
      "standard deviations %.2f\n",
      checks.size(), 100 * summary.least_known,
      100.0 * static_cast<double>(summary.within_close) / static_cast<double>(checks.size()),
      100 * summary.worst, summary.squares);
  return summary;
}

// LAMPGLOW_SCATTERING_SEED chooses other points and photons.
std::uint64_t chosen_seed() {
  const char* seed = std::getenv("LAMPGLOW_SCATTERING_SEED");
  return seed ? std::stoull(seed) : 20261122;
}

TEST(GlowTableAccuracy, AgreesWithFreshPhotonsAtFiveHundredRandomPoints) {
  Random random(chosen_seed());
  std::vector<Check> checks;
  for (std::uint64_t run = 0; run < 25; ++run) check_one_q(random, chosen_seed() + run, checks);
  ASSERT_EQ(checks.size(), 500u);
  const Summary summary = summarize(checks);
  EXPECT_LE(summary.least_known, 0.01);
  EXPECT_GE(static_cast<double>(summary.within_close), 0.95 * 500);
  EXPECT_LT(summary.squares, 1.5);
}

TEST(GlowTableAccuracy, ItsStoredNodesAgreeWithFreshPhotons) {
  const GlowTableOptions size;
  const GlowDomain domain;
  Random random(chosen_seed() + 1);
  // The node's place on an axis of so many, last one included.
  const auto node = [&](std::size_t nodes, double first, double last) {
    return first + (last - first) * random.below(static_cast<int>(nodes)) / static_cast<double>(nodes - 1);
  };
  std::vector<Check> checks;
  for (std::uint64_t i = 0; i < 48; ++i) {
    const double root = node(size.albedo_nodes, 0, std::sqrt(1 - domain.albedo_min));
    const double q = -std::expm1(-node(size.q_nodes, 0, -std::log1p(-domain.q_max)));
    const double thickness =
        std::exp(node(size.thickness_nodes, std::log(domain.thickness_min), std::log(domain.thickness_max)));
    const double theta =
        std::exp(node(size.theta_nodes, std::log(domain.theta_min_rad), std::log(domain.theta_max_rad)));
    // The mean over so narrow a ring is the node's value to 1e-4; at the table's ends it lies within.
    const double inner = std::max(theta * 0.98, domain.theta_min_rad);
    const double outer = std::min(theta * 1.02, domain.theta_max_rad);
    checks.push_back({thickness, q, 1 - root * root, inner, outer, 0, 0});
    count_collisions(checks.back(), chosen_seed() + i);
  }
  const Summary summary = summarize(checks);
  EXPECT_LE(summary.least_known, 0.01);
  EXPECT_LT(summary.squares, 2.2);
}

TEST(MonteCarloAccuracy, PhotonsInABallOfFogGiveTheValuesOfPhysicsMd) {
  // The values were counted in a finite ball, some 25 mean free paths in radius; 2 % and our photons' noise.
  const double theta_deg[] = {0.2, 0.5, 1, 2, 5, 10, 20, 40};
  const double value[2][3][8] = {{{18.0, 7.26, 3.59, 1.73, 0.605, 0.225, 0.0643, 0.0150},
                                  {2.32, 0.957, 0.496, 0.259, 0.105, 0.0461, 0.0166, 0.00509},
                                  {0.0821, 0.0396, 0.0243, 0.0160, 0.00950, 0.00610, 0.00350, 0.00173}},
                                 {{43.7, 17.1, 8.10, 3.52, 0.828, 0.188, 0.0326, 0.00549},
                                  {5.78, 2.40, 1.23, 0.590, 0.172, 0.0481, 0.0101, 0.00191},
                                  {0.226, 0.115, 0.0723, 0.0457, 0.0213, 0.00909, 0.00289, 0.000747}}};
  for (int k = 0; k < 2; ++k) {
    GlowPhotons run;
    run.q = k == 0 ? 0.75 : 0.9;
    run.thicknesses = {0.5, 1.5, 4};
    run.black_radius = 25;
    run.photons = 1'000'000;
    for (const double theta : theta_deg)
      for (const double side : {0.95, 1.05}) run.theta_edges_rad.push_back(theta * side * kDegree);
    const GlowEstimate glow = simulate_glow(run, on_two_threads);
    for (std::size_t t = 0; t < 3; ++t)
      for (std::size_t i = 0; i < 8; ++i) {
        const Estimate total = glow.total(0, t, 2 * i);
        const double expected = value[k][t][i];
        EXPECT_NEAR(total.value / expected, 1, 0.02 + 3 * total.sigma / expected)
            << run.q << " " << run.thicknesses[t] << " " << theta_deg[i];
      }
  }
}

// Processor time of the shortest of several runs: what the code costs when nobody else has the core.
template <typename F>
double seconds(int repeats, F&& work) {
  double best = 1e9;
  for (int i = 0; i < repeats; ++i) {
    const std::clock_t begin = std::clock();
    work();
    best = std::min(best, static_cast<double>(std::clock() - begin) / CLOCKS_PER_SEC);
  }
  return best;
}

TEST(Speed, ProfileOf64RingsWithBothDerivativesInTenMicroseconds) {
  std::vector<double> theta, total(64), d_t(64), d_q(64);
  for (int i = 0; i < 64; ++i) theta.push_back(0.15 * std::pow(50, i / 63.0) * kDegree);
  const double time =
      seconds(50,
              [&] {
                for (int i = 0; i < 200; ++i)
                  default_glow_table().profile(1.5 + 0.001 * i, 0.85, 0.98, theta, total, d_t, d_q);
              }) /
      200;
  std::printf("profile of 64 rings: %.2f us\n", time * 1e6);
#ifndef __SANITIZE_ADDRESS__
  EXPECT_LE(time, 10e-6);
#endif
}

TEST(Speed, RenderingCostsAtMostHalfMoreThanItsTransforms) {
  RenderOptions options;
  options.medium = {0.01, 1, 0.9};
  options.focal_length_px = 5000;
  std::vector<float> clear(std::size_t{4000} * 3000, 0.01f), out(clear.size());
  // In turns, so that a neighbour who comes for some seconds disturbs both.
  double render = 1e9, bare = 1e9;
  for (int turn = 0; turn < 5; ++turn) {
    render = std::min(render, seconds(1, [&] { render_glow(clear, 4000, 3000, {}, 100, options, out); }));
    bare = std::min(bare, seconds(1, [&] { bare_transforms(4000, 3000); }));
  }
  std::printf("12 Mpixel: %.2f s, bare transforms %.2f s, ratio %.2f\n", render, bare, render / bare);
#ifndef __SANITIZE_ADDRESS__
  EXPECT_LE(render / bare, 1.5);
#endif
}

}  // namespace
}  // namespace lampglow::scattering
