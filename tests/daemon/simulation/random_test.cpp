#include "daemon/simulation/random.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lampglow::simulation {
namespace {

TEST(Random, StreamsOfOneNameAreTheSameAndOfOthersAreNot) {
  Random a(7, {1, 2});
  Random b(7, {1, 2});
  Random other_name(7, {2, 1});
  Random other_seed(8, {1, 2});
  const std::uint64_t first = a.bits();
  EXPECT_EQ(first, b.bits());
  EXPECT_NE(first, other_name.bits());
  EXPECT_NE(first, other_seed.bits());
}

class PoissonOf : public testing::TestWithParam<double> {};

TEST_P(PoissonOf, MeanAndVarianceAreTheExpectation) {
  const double expected = GetParam();
  Random random(3, {1});
  constexpr int kDraws = 200000;
  double sum = 0;
  double squares = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double draw = random.poisson(expected);
    ASSERT_EQ(draw, std::floor(draw));
    sum += draw;
    squares += (draw - expected) * (draw - expected);
  }
  EXPECT_NEAR(sum / kDraws, expected, 5 * std::sqrt(expected / kDraws));
  EXPECT_NEAR(squares / kDraws / expected, 1, 5 * std::sqrt((2 + 1 / expected) / kDraws));
}

INSTANTIATE_TEST_SUITE_P(SmallAndLarge, PoissonOf, testing::Values(0.05, 3.0, 55.0, 61.0, 5000.0));

}  // namespace
}  // namespace lampglow::simulation
