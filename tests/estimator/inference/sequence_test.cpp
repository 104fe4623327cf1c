#include "estimator/inference/sequence.h"

#include <gtest/gtest.h>

#include <cmath>

#include "estimator/inference/weather.h"

namespace lampglow::inference {
namespace {

Observation at(int minute, double mor_m, Weather weather) {
  Observation o;
  o.time_utc = TimePoint(std::chrono::minutes(minute));
  o.extinction_per_m = kMorTimesExtinction / mor_m;
  o.extinction_low_per_m = *o.extinction_per_m * 0.9;
  o.extinction_high_per_m = *o.extinction_per_m * 1.1;
  o.weather = weather;
  return o;
}

TEST(Sequence,
     MeansAreOfExtinctionNotOfVisibility) {  // conventions.md: 200, 200, 5000, 5000 m average to 385 m
  Sequence sequence;
  for (int i = 0; i < 4; ++i) sequence.add(at(i, i < 2 ? 200 : 5000, Weather::unknown));
  const auto mean = sequence.mean(600);
  ASSERT_TRUE(mean);
  EXPECT_EQ(mean->count, 4);
  EXPECT_NEAR(kMorTimesExtinction / mean->extinction_per_m, 385, 1);
  EXPECT_EQ(sequence.mean(60)->count, 1);
}

TEST(Sequence, AMeanOfBothKindsOfLimitIsNone) {
  Sequence sequence;
  Observation high = at(0, 20000, Weather::clear), low = at(1, 30, Weather::fog);
  high.limit = Limit::above;
  low.limit = Limit::below;
  sequence.add(high);
  EXPECT_EQ(sequence.mean(600)->limit, Limit::above);
  sequence.add(low);
  EXPECT_FALSE(sequence.mean(600));
}

TEST(Sequence, FogIsLeftOnlyBeyondItsLimit) {
  Sequence sequence;
  sequence.add(at(0, 900, Weather::fog));
  EXPECT_EQ(sequence.add(at(1, 1100, Weather::mist)).weather, Weather::fog);
  EXPECT_EQ(sequence.add(at(2, 1250, Weather::mist)).weather, Weather::mist);
  EXPECT_EQ(sequence.add(at(3, 1250, Weather::mist)).wmo_4680, 20);  // fog in the past hour
}

TEST(Sequence, FogHoldsOnToNoClearAirToNoRainAndForTwentyMinutesOnly) {
  for (const auto& [minute, mor, weather] :
       {std::tuple{1, 5400.0, Weather::clear}, std::tuple{1, 1050.0, Weather::rain},
        std::tuple{60, 1100.0, Weather::mist}}) {
    Sequence sequence;
    sequence.add(at(0, 400, Weather::fog));
    EXPECT_EQ(sequence.add(at(minute, mor, weather)).weather, weather) << mor;
  }
}

TEST(Sequence, ThinningSteadyThickening) {
  for (const auto& [last, code] : {std::pair{800.0, 32}, std::pair{410.0, 33}, std::pair{250.0, 34}}) {
    Sequence sequence;
    std::optional<int> now;
    for (int minute = 0; minute <= 60; minute += 5)
      now = sequence.add(at(minute, 400 + (last - 400) * minute / 60.0, Weather::fog)).wmo_4680;
    EXPECT_EQ(now, code) << last;
  }
}

TEST(Sequence, FogThatComesAndGoesIsInPatches) {
  Sequence sequence;
  std::optional<int> now;
  for (int minute = 0; minute < 30; minute += 5)
    now = sequence
              .add(at(minute, minute % 10 == 0 ? 300 : 3000, minute % 10 == 0 ? Weather::fog : Weather::mist))
              .wmo_4680;
  now = sequence.add(at(30, 300, Weather::fog)).wmo_4680;
  EXPECT_EQ(now, 31);
}

TEST(Weather, ClassesAndWhenTheyCannotBeTold) {
  AirEstimate air{
      .ln_sigma = std::log(kMorTimesExtinction / 300), .ln_sigma_sd = 0.05, .q = 0.87, .q_sd = 0.01};
  EXPECT_EQ(decide_weather(weather_probabilities(air)), Weather::fog);
  air = {.ln_sigma = std::log(kMorTimesExtinction / 2500), .ln_sigma_sd = 0.05, .q = 0.75, .q_sd = 0.01};
  EXPECT_EQ(decide_weather(weather_probabilities(air)), Weather::haze);
  air.q = 0.95;
  EXPECT_EQ(decide_weather(weather_probabilities(air)), Weather::rain);
  air.q.reset();
  air.q_sd.reset();
  air.relative_humidity = 0.6;  // humidity decides between haze and mist
  const auto dry = weather_probabilities(air);
  EXPECT_GT(dry[static_cast<size_t>(Weather::haze)], 10 * dry[static_cast<size_t>(Weather::mist)]);
  double sum = 0;
  for (const double p : dry) sum += p;
  EXPECT_NEAR(sum, 1, 1e-12);
  EXPECT_EQ(decide_weather({0, 0.3, 0.35, 0.35, 0, 0}), Weather::unknown);
}

}  // namespace
}  // namespace lampglow::inference
