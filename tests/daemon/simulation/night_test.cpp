#include "daemon/simulation/night.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "daemon/simulation/weather.h"

namespace lampglow::simulation {
namespace {

// The classes as METAR and the lecture have them, written down again from conventions.md and physics.md.
void expect_class_fits(const Air& air) {
  switch (air.weather) {
    case Weather::clear:
      EXPECT_GT(air.mor_m, 5000);
      EXPECT_LT(air.q, 0.7);
      break;
    case Weather::haze:
      EXPECT_GE(air.mor_m, 1000);
      EXPECT_LE(air.mor_m, 5000);
      EXPECT_TRUE(air.q >= 0.7 && air.q <= 0.8) << air.q;
      break;
    case Weather::mist:
      EXPECT_GE(air.mor_m, 1000);
      EXPECT_LE(air.mor_m, 5000);
      EXPECT_TRUE(air.q >= 0.8 && air.q <= 0.85) << air.q;
      break;
    case Weather::fog:
      EXPECT_LT(air.mor_m, 1000);
      EXPECT_TRUE(air.q >= 0.85 && air.q <= 0.9) << air.q;
      break;
    case Weather::rain:
      EXPECT_TRUE(air.q >= 0.9 && air.q <= 1.0) << air.q;
      break;
    default:
      FAIL() << "no such weather";
  }
}

TEST(Weather, EverySampleFitsItsClassAndFogComesDownToTheLeast) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Random random(seed, {1});
    const std::vector<Air> night = draw_weather(45, 40, 25000, random);
    ASSERT_EQ(night.size(), 45u);
    std::set<double> different_q;
    std::set<Weather> classes;
    double least_m = 1e9;
    for (const Air& air : night) {
      expect_class_fits(air);
      different_q.insert(air.q);
      classes.insert(air.weather);
      least_m = std::min(least_m, air.mor_m);
    }
    EXPECT_LE(different_q.size(), 14u);
    EXPECT_EQ(classes.size(), 5u);
    EXPECT_LT(least_m, 80) << "seed " << seed;
  }
}

TEST(Weather, StaysWithinTheRangeThatIsAskedFor) {
  Random random(5, {1});
  for (const Air& air : draw_weather(200, 150, 1500, random)) {
    EXPECT_GE(air.mor_m, 150 - 1e-9);
    EXPECT_LE(air.mor_m, 1500 + 1e-9);
  }
}

TEST(Night, OneSeedIsOneNight) {
  const Night a = plan_night({.seed = 4});
  const Night b = plan_night({.seed = 4});
  const Night c = plan_night({.seed = 5});
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (size_t i = 0; i < a.frames.size(); ++i) {
    EXPECT_EQ(a.frames[i].extinction_per_m, b.frames[i].extinction_per_m);
    EXPECT_EQ(a.frames[i].lamp_strength, b.frames[i].lamp_strength);
  }
  EXPECT_NE(a.frames[10].extinction_per_m, c.frames[10].extinction_per_m);
}

TEST(Night, SwitchingOneNuisanceOffLeavesTheOthers) {
  NightOptions without_shake{.seed = 6};
  without_shake.nuisances.shake = false;
  const Night all = plan_night({.seed = 6});
  const Night still = plan_night(without_shake);
  for (size_t i = 0; i < all.frames.size(); ++i) {
    EXPECT_EQ(still.frames[i].shift_x_px, 0);
    EXPECT_EQ(still.frames[i].gain, all.frames[i].gain);
    EXPECT_EQ(still.frames[i].lamp_strength, all.frames[i].lamp_strength);
    EXPECT_EQ(still.frames[i].cars.size(), all.frames[i].cars.size());
  }
}

TEST(Night, NuisancesHaveTheSizeThatTheIssueNames) {
  double gain_squares = 0, shift_squares = 0, drift_squares = 0;
  int frames = 0, halved = 0, out = 0;
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const Night night = plan_night({.seed = seed});
    for (size_t i = kReferenceFrames; i < night.frames.size(); ++i, ++frames) {
      const Frame& frame = night.frames[i];
      gain_squares += std::pow(std::log(frame.gain), 2);
      shift_squares += frame.shift_x_px * frame.shift_x_px + frame.shift_y_px * frame.shift_y_px;
      const double strength = frame.lamp_strength[0];
      halved += strength > 0 && strength < 0.7;
      out += strength == 0;
      drift_squares += strength > 0.75 ? std::pow(std::log(strength), 2) : 0;
    }
  }
  EXPECT_NEAR(std::sqrt(gain_squares / frames), 0.12, 0.02);
  EXPECT_NEAR(std::sqrt(shift_squares / frames), 2.5, 0.2);
  EXPECT_NEAR(std::sqrt(drift_squares / (frames - halved - out)), 0.06, 0.01);
  EXPECT_GT(halved, frames / 10);
  EXPECT_GT(out, 0);
}

TEST(Night, ReferenceIsClearAndQuiet) {
  const Night night = plan_night({.seed = 9});
  for (size_t i = 0; i < kReferenceFrames; ++i) {
    const Frame& frame = night.frames[i];
    EXPECT_EQ(frame.role, FrameRole::clear_reference);
    EXPECT_GE(frame.mor_m(), 15000);
    EXPECT_TRUE(frame.cars.empty());
    EXPECT_NEAR(frame.gain, 1, 0.05);
    EXPECT_LT(std::hypot(frame.shift_x_px, frame.shift_y_px), 1);
  }
}

TEST(Night, LampsAreSpreadInDistanceAndStandApart) {
  for (const int count : {1, 3, 7, 20, 40}) {
    const Night night = plan_night({.seed = 2, .lamps = count});
    ASSERT_EQ(night.stray_from, count);
    for (int i = 0; i < count; ++i) {
      const Lamp& lamp = night.lamps[static_cast<size_t>(i)];
      EXPECT_TRUE(lamp.x_px > 0 && lamp.x_px < kWidthPx && lamp.y_px > 0 && lamp.y_px < kHeightPx);
      for (int j = 0; j < i; ++j) {
        const Lamp& other = night.lamps[static_cast<size_t>(j)];
        EXPECT_GT(std::hypot(lamp.x_px - other.x_px, lamp.y_px - other.y_px), 10);
      }
    }
    if (count > 1) {
      EXPECT_NEAR(night.lamps[0].distance_m, 60, 1e-6);
      EXPECT_NEAR(night.lamps[static_cast<size_t>(count - 1)].distance_m, 1200, 1e-6);
    }
  }
}

TEST(Night, CatalogueListsOnlyWhatIsAskedFor) {
  const Night night = plan_night({.distances_m = {60, 100, 180}, .catalogue = {"L3"}});
  EXPECT_FALSE(night.lamps[0].in_catalogue);
  EXPECT_FALSE(night.lamps[1].in_catalogue);
  EXPECT_TRUE(night.lamps[2].in_catalogue);
  EXPECT_EQ(night.lamps[2].distance_m, 180);
}

}  // namespace
}  // namespace lampglow::simulation
