#include "estimator/inference/posterior.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace lampglow::inference {
namespace {

// −ln p over MOR from 20 m to 300 km as the least of parabolas in ln MOR, each at `mor_m` with `sd` and
// depth.
struct Mode {
  double mor_m, sd, least;
};

std::vector<PosteriorPoint> posterior(const std::vector<Mode>& modes) {
  std::vector<PosteriorPoint> points;
  constexpr int kPoints = 481;  // from 300 km to 20 m
  for (int i = 0; i < kPoints; ++i) {
    const double ln_mor = std::log(3e5) - 0.02 * i;
    PosteriorPoint point;
    point.ln_sigma = std::log(kMorTimesExtinction) - ln_mor;
    point.minus_ln_probability = 1e9;
    for (const Mode& mode : modes) {
      const double z = (ln_mor - std::log(mode.mor_m)) / mode.sd;
      point.minus_ln_probability = std::min(point.minus_ln_probability, mode.least + 0.5 * z * z);
    }
    points.push_back(point);
  }
  return points;
}

TEST(Posterior, LimitWhereOneSideIsOpen) {
  std::vector<PosteriorPoint> p;
  for (int i = 0; i <= 20; ++i) {  // flat below ln σ = -8, a parabola above
    const double x = -10 + 0.2 * i;
    p.push_back({x, x < -8 ? 0.0 : (x + 8) * (x + 8) / (2 * 0.25), 0.8, 0.1});
  }
  const SigmaBounds bounds = sigma_bounds(p, {});
  EXPECT_EQ(bounds.limit, Limit::above);
  EXPECT_NEAR(std::log(bounds.value), -8 + 1.645 * 0.5, 0.05);
  EXPECT_FALSE(bounds.low);
}

TEST(Posterior, NormalGivesItsOwnBounds) {
  std::vector<PosteriorPoint> p;
  for (int i = -8; i <= 8; ++i) p.push_back({-6 + 0.05 * i, 0.5 * i * i * 0.25, 0.8, 0.1});
  const SigmaBounds bounds = sigma_bounds(p, {});
  EXPECT_EQ(bounds.limit, Limit::none);
  EXPECT_NEAR(std::log(*bounds.high) + 6, 1.96 * 0.1, 0.003);
  EXPECT_NEAR(std::log(*bounds.low) + 6, -1.96 * 0.1, 0.003);
  EXPECT_THROW(sigma_bounds({}, {}), std::invalid_argument);
}

TEST(Posterior, ANarrowOneIsAValueWithItsBounds) {
  const SigmaBounds bounds = sigma_bounds(posterior({{500, 0.1, 0}}), {});
  EXPECT_EQ(bounds.limit, Limit::none);
  EXPECT_NEAR(kMorTimesExtinction / bounds.value, 500, 6);
  EXPECT_NEAR(std::log(*bounds.high / *bounds.low), 2 * 1.96 * 0.1, 0.01);
  EXPECT_NEAR(bounds.ln_sd, 0.1, 0.005);
}

// Errors that all rings share widen a value's bounds, and leave limits as they are.
TEST(Posterior, AFloorIsAddedInSquares) {
  const SigmaBounds bounds = sigma_bounds(posterior({{500, 0.1, 0}}), {.ln_floor = 0.07});
  EXPECT_NEAR(std::log(*bounds.high / *bounds.low), 2 * 1.96 * std::hypot(0.1, 0.07), 0.01);
  EXPECT_NEAR(bounds.ln_sd, std::hypot(0.1, 0.07), 0.005);
  const auto open = posterior({{2e5, 1.5, 0}});
  EXPECT_EQ(sigma_bounds(open, {.ln_floor = 0.07}).value, sigma_bounds(open, {}).value);
}

// The limit holds with 95 %, of the profile and of the weight both, whichever asks for more.
TEST(Posterior, OpenTowardsClearAirIsALimitAbove) {
  const SigmaBounds bounds = sigma_bounds(posterior({{2e5, 1.5, 0}}), {});
  EXPECT_EQ(bounds.limit, Limit::above);
  const double away = std::log(2e5 * bounds.value / kMorTimesExtinction) / 1.5;
  EXPECT_GT(away, 1.63);
  EXPECT_LT(away, 1.96);
  EXPECT_FALSE(bounds.low);
}

TEST(Posterior, OpenTowardsThickFogIsALimitBelow) {
  const SigmaBounds bounds = sigma_bounds(posterior({{30, 1, 0}}), {});
  EXPECT_EQ(bounds.limit, Limit::below);
  const double away = std::log(kMorTimesExtinction / bounds.value / 30);
  EXPECT_GT(away, 1.63);
  EXPECT_LT(away, 1.96);
}

// Two modes in clear air, the better one far out with a near end beyond it: "below 230 km" would be true and
// of no use, "above" the nearer mode's end is what one wants to know.
TEST(Posterior, ClearAirIsNeverALimitBelow) {
  const SigmaBounds bounds = sigma_bounds(posterior({{170e3, 0.2, 0}, {25e3, 0.2, 1.4}}), {});
  EXPECT_EQ(bounds.limit, Limit::above);
  EXPECT_LT(kMorTimesExtinction / bounds.value, 25e3);
  EXPECT_GT(kMorTimesExtinction / bounds.value, 15e3);
}

}  // namespace
}  // namespace lampglow::inference
