#include "storage/means.h"

#include <gtest/gtest.h>

#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using testing_support::at;
using testing_support::foggy;
using testing_support::harbour;
using testing_support::without_value;

Observation with_mor(double mor_m) {
  return foggy(at("2026-11-22T01:00:30Z"), kMorTimesExtinction / mor_m).observation;
}

Observation limited(Limit limit, double mor_m) {
  Observation o = with_mor(mor_m);
  o.limit = limit;
  o.extinction_low_per_m.reset();
  o.extinction_high_per_m.reset();
  return o;
}

// The example of WMO-No. 8: 200, 200, 5000, 5000 m average to 385 m, not 2600 m.
TEST(Means, AverageExtinctionNotVisibility) {
  const std::array frames = {with_mor(200), with_mor(200), with_mor(5000), with_mor(5000)};
  const ObservationRow mean = mean_of(frames, at("2026-11-22T01:01:00Z"), 60);
  EXPECT_NEAR(mean.observation.mor_m().value(), 384.6, 0.1);
  EXPECT_EQ(mean.observation.limit, Limit::none);
  EXPECT_EQ(mean.frames, 4);
  EXPECT_EQ(mean.values, 4);
}

TEST(Means, PeriodsHaveTheirEndAndNotTheirStart) {
  EXPECT_EQ(period_end(at("2026-11-22T01:00:00Z"), 60), at("2026-11-22T01:00:00Z"));
  EXPECT_EQ(period_end(at("2026-11-22T01:00:00.001Z"), 60), at("2026-11-22T01:01:00Z"));
  EXPECT_EQ(period_end(at("2026-11-22T01:00:01Z"), 600), at("2026-11-22T01:10:00Z"));
  EXPECT_EQ(period_end(at("2026-11-22T23:59:59Z"), 3600), at("2026-11-23T00:00:00Z"));
}

TEST(Means, AnAboveAmongThickFogIsStillAValueWithAWiderLowerBound) {
  const std::array frames = {with_mor(200), limited(Limit::above, 10000)};
  const Observation mean = mean_of(frames, at("2026-11-22T01:01:00Z"), 60).observation;
  EXPECT_EQ(mean.limit, Limit::none);
  EXPECT_NEAR(mean.extinction_low_per_m.value(), 0.9 * kMorTimesExtinction / 200 / 2, 1e-12);
}

TEST(Means, AllAboveIsAbove) {
  const std::array frames = {limited(Limit::above, 8000), limited(Limit::above, 12000)};
  const Observation mean = mean_of(frames, at("2026-11-22T01:01:00Z"), 60).observation;
  EXPECT_EQ(mean.limit, Limit::above);
  EXPECT_FALSE(mean.extinction_low_per_m);
}

TEST(Means, OneBelowMakesItBelow) {
  const std::array frames = {with_mor(200), limited(Limit::below, 20)};
  EXPECT_EQ(mean_of(frames, at("2026-11-22T01:01:00Z"), 60).observation.limit, Limit::below);
}

TEST(Means, WithoutAValueThereIsNone) {
  const std::array frames = {without_value(at("2026-11-22T12:00:00Z")).observation};
  const ObservationRow mean = mean_of(frames, at("2026-11-22T12:00:00Z"), 60);
  EXPECT_FALSE(mean.observation.extinction_per_m);
  EXPECT_EQ(mean.frames, 1);
  EXPECT_EQ(mean.values, 0);
  EXPECT_TRUE(mean.observation.quality.has(Quality::daylight));
}

TEST(Means, AreRenewedWhenALateFrameComes) {
  testing_support::TemporaryDirectory directory;
  Store store(directory / "x.db");
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  store.put(camera, foggy(at("2026-11-22T01:00:20Z"), 0.01));
  store.put(camera, foggy(at("2026-11-22T01:20:00Z"), 0.05));
  store.commit();
  store.put(camera, foggy(at("2026-11-22T01:00:40Z"), 0.02));
  store.commit();
  Reader reader(directory / "x.db");
  const auto minutes =
      reader.observations({camera, at("2026-11-22T00:00:00Z"), at("2026-11-23T00:00:00Z"), 60, {}, 10});
  ASSERT_EQ(minutes.size(), 2u);
  EXPECT_EQ(minutes[0].observation.time_utc, at("2026-11-22T01:01:00Z"));
  EXPECT_NEAR(minutes[0].observation.extinction_per_m.value(), 0.015, 1e-15);
  EXPECT_EQ(minutes[0].frames, 2);
  const auto hour = reader.latest(camera, 3600);
  ASSERT_TRUE(hour);
  EXPECT_EQ(hour->observation.time_utc, at("2026-11-22T02:00:00Z"));
  EXPECT_NEAR(hour->observation.extinction_per_m.value(), 0.08 / 3, 1e-15);
}

}  // namespace
}  // namespace lampglow::storage
