// Every expected figure here is worked by hand from the few pairs beside it.
#include "daemon/replay/scores.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lampglow::daemon {
namespace {

using namespace std::chrono_literals;

Observation value(double mor_m, double low_m = 0, double high_m = 0) {
  Observation o;
  o.extinction_per_m = kMorTimesExtinction / mor_m;
  if (high_m > 0) o.extinction_low_per_m = kMorTimesExtinction / high_m;
  if (low_m > 0) o.extinction_high_per_m = kMorTimesExtinction / low_m;
  return o;
}

Observation limit(Limit kind, double mor_m) {
  Observation o = value(mor_m);
  o.limit = kind;
  return o;
}

ScoredPair pair(const Observation& estimate, double truth_m, std::optional<Weather> weather = std::nullopt) {
  return {estimate, {TimePoint{}, truth_m, {}, {}, weather}};
}

TEST(Scores, WmoLimits) {
  EXPECT_DOUBLE_EQ(wmo_allowed_error_m(50), 50);
  EXPECT_DOUBLE_EQ(wmo_allowed_error_m(600), 50);
  EXPECT_DOUBLE_EQ(wmo_allowed_error_m(1000), 100);
  EXPECT_DOUBLE_EQ(wmo_allowed_error_m(1500), 150);
  EXPECT_DOUBLE_EQ(wmo_allowed_error_m(2000), 400);
}

TEST(Scores, CountsValuesLimitsAndGapsApart) {
  const Scores s = score({pair(value(340), 300),                  // within 50 m
                          pair(value(360), 300),                  // not
                          pair(value(1090), 1000),                // within 10 %
                          pair(value(8000), 10000),               // within 20 %: exactly at the edge is in
                          pair(limit(Limit::above, 5000), 5000),  // kept
                          pair(limit(Limit::above, 5000), 4999),  // broken
                          pair(limit(Limit::below, 50), 40),      // kept
                          pair(Observation{}, 700)});
  EXPECT_EQ(s.pairs, 8U);
  EXPECT_EQ(s.values, 4U);
  EXPECT_EQ(s.limits, 3U);
  EXPECT_EQ(s.none, 1U);
  EXPECT_EQ(s.within_wmo, 3U);
  EXPECT_EQ(s.limits_right, 2U);
  EXPECT_DOUBLE_EQ(s.within_wmo_share.value(), 0.75);
  EXPECT_DOUBLE_EQ(s.within_wmo_share_of_all.value(), 3.0 / 8);
}

TEST(Scores, LogErrorsAndBias) {
  // ln ratios: ln 2, -ln 2, 0, ln 4 = 2 ln 2. |.| sorted: 0, 1, 1, 2 (in ln 2): median 1; the 95th percentile
  // lies at rank 0.95 * 3 = 2.85: 1 + 0.85 * (2 - 1) = 1.85. Mean: (1 - 1 + 0 + 2) / 4 = 0.5.
  const Scores s = score({pair(value(200), 100), pair(value(100), 200), pair(value(300), 300),
                          pair(value(400), 100), pair(limit(Limit::above, 1), 1e4)});
  EXPECT_NEAR(s.median_abs_ln.value(), std::log(2), 1e-12);
  EXPECT_NEAR(s.p95_abs_ln.value(), 1.85 * std::log(2), 1e-12);
  EXPECT_NEAR(s.bias_ln.value(), 0.5 * std::log(2), 1e-12);
}

TEST(Scores, CoverageCountsValuesWithBothBounds) {
  const Scores s = score({pair(value(100, 80, 120), 110), pair(value(100, 80, 120), 130),
                          pair(value(100, 80, 120), 79), pair(value(100, 80), 500), pair(value(100), 100)});
  EXPECT_EQ(s.bounded, 3U);
  EXPECT_DOUBLE_EQ(s.coverage.value(), 1.0 / 3);
}

TEST(Scores, SpearmanWithTies) {
  EXPECT_DOUBLE_EQ(spearman({1, 2, 3, 4}, {10, 20, 30, 400}).value(), 1);
  EXPECT_DOUBLE_EQ(spearman({1, 2, 3, 4}, {4, 3, 2, 1}).value(), -1);
  // Ranks 1, 2.5, 2.5, 4 and 1, 2, 3, 4: sum of products of deviations 1.5*1.5 + 0 + 0 + 1.5*1.5 = 4.5;
  // squares 4.5 and 5: 4.5 / sqrt(22.5).
  EXPECT_DOUBLE_EQ(spearman({1, 2, 2, 3}, {1, 2, 3, 4}).value(), 4.5 / std::sqrt(22.5));
  EXPECT_FALSE(spearman({1, 1, 1}, {1, 2, 3})) << "no order in one of them";
  EXPECT_FALSE(spearman({1, 2}, {1, 2})) << "too few";
}

TEST(Scores, FogConfusionTakesLimitsWhereTheyDecide) {
  const Scores s =
      score({pair(value(900), 500), pair(value(1000), 999), pair(value(999), 1000), pair(value(5000), 5000),
             pair(limit(Limit::above, 1000), 3000), pair(limit(Limit::above, 999), 3000),
             pair(limit(Limit::below, 60), 40), pair(Observation{}, 40)});
  EXPECT_EQ(s.fog[1][1], 2U);  // 900 and the `below`
  EXPECT_EQ(s.fog[1][0], 1U);  // 1000 is no fog
  EXPECT_EQ(s.fog[0][1], 1U);
  EXPECT_EQ(s.fog[0][0], 2U);
  EXPECT_EQ(s.fog_undecided, 2U);
  EXPECT_DOUBLE_EQ(s.fog_right_share.value(), 4.0 / 6);
}

TEST(Scores, WeatherConfusion) {
  Observation fog = value(500);
  fog.weather = Weather::fog;
  const Scores s =
      score({pair(fog, 500, Weather::fog), pair(fog, 500, Weather::rain), pair(value(500), 500)});
  EXPECT_EQ(s.weather_pairs, 2U);
  EXPECT_EQ(s.weather[static_cast<int>(Weather::rain)][static_cast<int>(Weather::fog)], 1U);
  EXPECT_DOUBLE_EQ(s.weather_right_share.value(), 0.5);
}

TEST(Scores, NothingIsUnknownAndNotZero) {
  const Scores s = score({});
  EXPECT_FALSE(s.within_wmo_share || s.within_wmo_share_of_all || s.median_abs_ln || s.p95_abs_ln ||
               s.bias_ln || s.coverage || s.spearman || s.fog_right_share || s.weather_right_share);
}

TEST(Scores, MatchesByTimeAndLeavesOutTheRest) {
  Observation at_one = value(100), at_two = value(200);
  at_one.time_utc = TimePoint{1s};
  at_two.time_utc = TimePoint{2s};
  const auto pairs = match_truth({at_one, at_two}, {{TimePoint{2s}, 250.0, {}, {}, {}},
                                                    {TimePoint{1s}, std::nullopt, {}, {}, {}},
                                                    {TimePoint{3s}, 1.0, {}, {}, {}}});
  ASSERT_EQ(pairs.size(), 1U);
  EXPECT_EQ(pairs[0].truth.mor_m, 250.0);
}

TEST(Scores, RangesPartTheTruth) {
  const auto ranges = score_by_range({pair(value(1), 599), pair(value(1), 600), pair(value(1), 1500),
                                      pair(value(1), 5000), pair(value(1), 6000)});
  ASSERT_EQ(ranges.size(), 4U);
  EXPECT_EQ(ranges[0].scores.pairs, 1U);
  EXPECT_EQ(ranges[1].scores.pairs, 1U);
  EXPECT_EQ(ranges[2].scores.pairs, 1U);
  EXPECT_EQ(ranges[3].scores.pairs, 2U);
}

}  // namespace
}  // namespace lampglow::daemon
