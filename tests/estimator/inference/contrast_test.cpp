#include <gtest/gtest.h>

#include <cmath>
#include <iostream>

#include "estimator/inference/contrast_day.h"
#include "tests/estimator/inference/day_scene.h"

namespace lampglow::inference {
namespace {

using lampglow::testing::day_scene;
using lampglow::testing::DayScene;
using lampglow::testing::draw_day;

FrameResult measure(const DayScene& scene, const photometry::RadianceImage& image) {
  FrameResult result;
  measure_day(image, scene.site, SunPosition{30, 180}, true, std::nullopt, {}, result);
  return result;
}

double wmo_allowed(double mor) {
  return mor <= 600 ? 50 : mor <= 1500 ? 0.1 * mor : 0.2 * mor;
}

TEST(ContrastModel, HasKoschmiedersLimits) {
  EXPECT_DOUBLE_EQ(airlight_ratio(0.07, 1.0), 0.07);  // no haze: the target's own brightness
  EXPECT_DOUBLE_EQ(airlight_ratio(0.07, 0.0), 1.0);   // all haze: the horizon
  EXPECT_NEAR(1 - airlight_ratio(0.0, std::exp(-kMorTimesExtinction)), 0.05, 1e-12);  // MOR: 5 % contrast
}

TEST(ContrastModel, GradientEnergyAddsUp) {
  EXPECT_NEAR(log_gradient_energy(-2.0, 0, 0), -4.0, 1e-12);
  EXPECT_NEAR(log_gradient_energy(-50.0, 0.25, 0.75), 0.0, 1e-12);
}

TEST(ContrastModel, SlopeIsThatOfFiniteDifferences) {
  for (const double u : {-9.0, -4.0, -1.5})
    for (const double floor : {0.0, 1e-4})
      for (const double noise : {1e-6, 1e-3}) {
        const double step = 1e-5;
        const double difference =
            (log_gradient_energy(u + step, floor, noise) - log_gradient_energy(u - step, floor, noise)) /
            (2 * step);
        EXPECT_NEAR(gradient_energy_slope(u, log_gradient_energy(u, floor, noise)), difference,
                    1e-6 * (difference + 1e-3))
            << u << " " << floor << " " << noise;
      }
}

TEST(ContrastDay, LowSunAndTheSunInThePictureAreFlagged) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(5);
  photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / 2000, random);
  const auto flags = [&](double altitude_deg) {
    FrameResult result;
    measure_day(image, scene.site, SunPosition{altitude_deg, 180}, true, std::nullopt, {}, result);
    EXPECT_TRUE(result.observation.mor_m());
    return result.observation.quality;
  };
  EXPECT_FALSE(flags(30).has(Quality::low_sun));
  EXPECT_FALSE(flags(30).has(Quality::sun_in_picture));
  EXPECT_TRUE(flags(3).has(Quality::low_sun));
  for (int y = 0; y < 52; ++y)  // a good quarter of the picture, in the sky above all targets
    for (int x = 0; x < image.mask.width_px; ++x) image.mask.at(x, y) |= photometry::kSaturated;
  EXPECT_TRUE(flags(3).has(Quality::sun_in_picture));
}

// Four targets from 150 m to 4 km, 240 scenes, MOR 50 m to 8 km: within the WMO limits, and the bounds cover.
TEST(ContrastDay, FourTargetsMeasureWithinTheWmoLimits) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(20261122);
  int within = 0, values = 0, covered = 0, limits_true = 0, limits = 0;
  constexpr int kScenes = 240;
  for (int i = 0; i < kScenes; ++i) {
    const double mor = 50 * std::pow(8000.0 / 50.0, (i + 0.5) / kScenes);
    const Observation o = measure(scene, draw_day(scene, kMorTimesExtinction / mor, random)).observation;
    ASSERT_TRUE(o.mor_m()) << mor;
    if (o.limit != Limit::none) {
      ++limits;
      limits_true += o.limit == Limit::above ? mor >= *o.mor_m() : mor <= *o.mor_m();
      continue;
    }
    ++values;
    within += std::abs(*o.mor_m() - mor) <= wmo_allowed(mor);
    covered += mor >= o.mor_low_m().value_or(0) && mor <= o.mor_high_m().value_or(1e9);
  }
  std::cout << "values " << values << ", within " << within << ", covered " << covered << ", limits "
            << limits << ", true " << limits_true << "\n";
  EXPECT_GE(within, 0.90 * kScenes);
  EXPECT_GE(covered, 0.90 * values);
  EXPECT_LE(covered, 0.995 * values);
}

TEST(ContrastDay, ClearerThanTheTargetsTellIsALimitThatHolds) {
  const DayScene scene = day_scene({150, 500});
  std::mt19937_64 random(7);
  int above = 0, holds = 0;
  for (int i = 0; i < 40; ++i) {
    const double mor = 20e3 + 1e3 * i;
    const Observation o = measure(scene, draw_day(scene, kMorTimesExtinction / mor, random)).observation;
    above += o.limit == Limit::above;
    holds += o.limit == Limit::above && mor >= *o.mor_m();
    EXPECT_EQ(o.quality.has(Quality::limit_above), o.limit == Limit::above);
  }
  EXPECT_GE(above, 36);
  EXPECT_GE(holds, above * 9 / 10);
}

TEST(ContrastDay, OneTargetAndTheSkyAreEnough) {
  const DayScene scene = day_scene({500});
  std::mt19937_64 random(3);
  int near = 0;
  for (int i = 0; i < 30; ++i) {
    const double mor = 400 + 30 * i;
    const Observation o = measure(scene, draw_day(scene, kMorTimesExtinction / mor, random)).observation;
    near += o.limit == Limit::none && std::abs(std::log(*o.mor_m() / mor)) < 0.2;
    EXPECT_EQ(o.lights_used, 1);
  }
  EXPECT_GE(near, 27);
}

TEST(ContrastDay, FogThickerThanTheNearestTargetIsBelowOrHonestlyWide) {
  const DayScene scene = day_scene({1500, 4000});
  std::mt19937_64 random(4);
  for (int i = 0; i < 10; ++i) {
    const Observation o = measure(scene, draw_day(scene, kMorTimesExtinction / 60, random)).observation;
    ASSERT_EQ(o.limit, Limit::below);
    EXPECT_GE(*o.mor_m(), 60);
  }
}

// A lorry before one target: its brightness is not the target's.
TEST(ContrastDay, OneWrongTargetOfFourDoesNotDecide) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(5);
  int near = 0;
  for (int i = 0; i < 20; ++i) {
    photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / 2000, random);
    const Target& box = scene.site.targets[0];
    for (int y = static_cast<int>(box.y_px); y < static_cast<int>(box.y_px + box.height_px); ++y)
      for (int x = static_cast<int>(box.x_px); x < static_cast<int>(box.x_px + box.width_px); ++x)
        image.radiance.at(x, y) *= 3;
    const Observation o = measure(scene, image).observation;
    near += o.mor_m() && std::abs(std::log(*o.mor_m() / 2000)) < 0.3;
  }
  EXPECT_GE(near, 18);
}

TEST(ContrastDay, SnowOnTheNearTargetsIsFlaggedAndDoesNotPassForFog) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(9);
  photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / 8000, random);
  EXPECT_FALSE(measure(scene, image).observation.quality.has(Quality::snow));
  for (const size_t near : {0U, 1U}) {
    const Target& box = scene.site.targets[near];
    const float sky = image.radiance.at(static_cast<int>(box.x_px), static_cast<int>(box.y_px) - 10);
    for (int y = static_cast<int>(box.y_px) + 4; y < static_cast<int>(box.y_px + box.height_px); ++y)
      for (int x = static_cast<int>(box.x_px); x < static_cast<int>(box.x_px + box.width_px); ++x)
        image.radiance.at(x, y) = 0.85F * sky;
  }
  const Observation snowy = measure(scene, image).observation;
  EXPECT_TRUE(snowy.quality.has(Quality::snow));
  ASSERT_TRUE(snowy.mor_m());
  EXPECT_GT(*snowy.mor_m(), 4000);
}

TEST(ContrastDay, SaysWhyThereIsNoValue) {
  DayScene scene = day_scene({500});
  std::mt19937_64 random(6);
  const auto image = draw_day(scene, 1e-3, random);
  FrameResult night;
  measure_day(image, scene.site, SunPosition{-20, 0}, true, std::nullopt, {}, night);
  EXPECT_FALSE(night.observation.extinction_per_m);
  EXPECT_NE(night.reason.find("night"), std::string::npos);

  DayScene learned = scene;
  learned.site.day = DayCalibration{};
  learned.site.day->colour = true;
  EXPECT_TRUE(measure(learned, image).observation.quality.has(Quality::night_mode));

  scene.site.targets[0].distance_m.reset();
  EXPECT_TRUE(measure(scene, image).observation.quality.has(Quality::unknown_distance));
  scene.site.targets.clear();
  const FrameResult none = measure(scene, image);
  EXPECT_TRUE(none.observation.quality.has(Quality::no_targets));
  EXPECT_FALSE(none.reason.empty());
}

TEST(Widened, AddsTheVarianceOfTheSharedError) {
  std::vector<PosteriorPoint> narrow;
  for (int i = -200; i <= 200; ++i) narrow.push_back({0.02 * i, 0.5 * std::pow(0.02 * i / 0.3, 2), 0, 0});
  const auto wide = widened(narrow, 0.4);
  double sum = 0, second = 0;
  for (const auto& p : wide) {
    sum += std::exp(-p.minus_ln_probability);
    second += std::exp(-p.minus_ln_probability) * p.ln_sigma * p.ln_sigma;
  }
  EXPECT_NEAR(std::sqrt(second / sum), 0.5, 0.005);
}

}  // namespace
}  // namespace lampglow::inference
