#include <gtest/gtest.h>

#include <cmath>
#include <iostream>

#include "estimator/inference/contrast_day.h"
#include "estimator/inference/day_reference.h"
#include "tests/estimator/inference/day_scene.h"

namespace lampglow::inference {
namespace {

using lampglow::testing::day_scene;
using lampglow::testing::DayScene;
using lampglow::testing::draw_day;

FrameResult measure(const DayScene& scene, const photometry::RadianceImage& image, double altitude_deg = 30) {
  FrameResult result;
  measure_day(image, scene.site, SunPosition{altitude_deg, 180}, true, std::nullopt, {}, result);
  return result;
}

// Do the 95 % bounds, or the limit, hold?
bool holds(const Observation& o, double mor) {
  if (o.limit != Limit::none) return o.limit == Limit::above ? mor >= *o.mor_m() : mor <= *o.mor_m();
  return mor >= o.mor_low_m().value_or(0) && mor <= o.mor_high_m().value_or(1e9);
}

// The sky above a target's box, without its noise.
double sky_above(const photometry::RadianceImage& image, const Target& box) {
  double sum = 0;
  int n = 0;
  for (int y = static_cast<int>(box.y_px) - 14; y < static_cast<int>(box.y_px) - 4; ++y)
    for (int x = static_cast<int>(box.x_px); x < static_cast<int>(box.x_px + box.width_px); ++x)
      sum += image.radiance.at(x, y), ++n;
  return sum / n;
}

// A target's own light, from one part of its box's width to another, times `factor`; the airlight before it
// stays.
void relight(photometry::RadianceImage& image, const DayScene& scene, size_t target, double sigma,
             double from, double to, double factor) {
  const Target& box = scene.site.targets[target];
  const double airlight = (1 - std::exp(-sigma * scene.distances_m[target])) * sky_above(image, box);
  const int left = static_cast<int>(box.x_px), top = static_cast<int>(box.y_px);
  for (int y = top + 4; y < top + static_cast<int>(box.height_px); ++y)
    for (int x = left + static_cast<int>(from * box.width_px); x < left + static_cast<int>(to * box.width_px);
         ++x) {
      float& value = image.radiance.at(x, y);
      value = static_cast<float>(airlight + factor * (value - airlight));
    }
}

// Learns the targets from two clear frames.
DayScene known_scene(const std::vector<double>& distances_m, std::mt19937_64& random) {
  DayScene scene = day_scene(distances_m);
  ClearTargetLearner learner(scene.site);
  for (int frame = 0; frame < 2; ++frame) learner.add(draw_day(scene, kMorTimesExtinction / 25e3, random));
  return scene;
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

// Broken clouds: the sun on one half of a target. Flagged where it is seen, in clear air; the bounds hold
// everywhere.
TEST(ContrastDay, ShadowsAreFlaggedAndTheBoundsHold) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform;
  const DayScene scene = known_scene({150, 500, 1400, 4000}, random);
  int flagged = 0, falsely = 0, held = 0;
  constexpr int kScenes = 60;
  for (int i = 0; i < kScenes; ++i) {
    const double mor = 800 * std::pow(10.0, (i + 0.5) / kScenes), sigma = kMorTimesExtinction / mor;
    photometry::RadianceImage image = draw_day(scene, sigma, random);
    falsely += measure(scene, image).observation.quality.has(Quality::shadows);
    relight(image, scene, i % 2, sigma, 0.5 * (i / 2 % 2), 0.5 + 0.5 * (i / 2 % 2),
            2.5 + 1.5 * uniform(random));
    const Observation o = measure(scene, image).observation;
    flagged += o.quality.has(Quality::shadows);
    held += holds(o, mor);
  }
  std::cout << "shadows flagged " << flagged << ", falsely " << falsely << ", bounds held " << held << " of "
            << kScenes << "\n";
  EXPECT_GE(flagged, kScenes * 8 / 10);
  EXPECT_LE(falsely, 2);
  EXPECT_GE(held, kScenes * 9 / 10);
}

// Lit from the side or from behind the camera: up to three times as bright as usual, all alike.
TEST(ContrastDay, LowSunOnTheTargetsKeepsTheBoundsTrue) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(12);
  std::uniform_real_distribution<double> uniform;
  int held = 0;
  double width = 0, usual_width = 0;
  constexpr int kScenes = 60;
  for (int i = 0; i < kScenes; ++i) {
    const double mor = 200 * std::pow(40.0, (i + 0.5) / kScenes);
    const double lit = 1 + 2 * uniform(random);
    const photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / mor, random, 4, lit);
    const Observation low = measure(scene, image, 4).observation,
                      high = measure(scene, image, 30).observation;
    EXPECT_TRUE(low.quality.has(Quality::low_sun));
    held += holds(low, mor);
    if (low.limit != Limit::none || high.limit != Limit::none) continue;
    width += std::log(*low.mor_high_m() / *low.mor_low_m());
    usual_width += std::log(*high.mor_high_m() / *high.mor_low_m());
  }
  std::cout << "low sun: bounds held " << held << " of " << kScenes << ", " << width / usual_width
            << " times as wide as usual\n";
  EXPECT_GE(held, kScenes * 9 / 10);
  EXPECT_GT(width, 1.05 * usual_width);
}

// Glare lies over target and sky alike, and passes for haze.
TEST(ContrastDay, TheSunsGlareKeepsTheBoundsTrue) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(13);
  std::uniform_real_distribution<double> uniform;
  int held = 0;
  constexpr int kScenes = 60;
  for (int i = 0; i < kScenes; ++i) {
    const double mor = 200 * std::pow(40.0, (i + 0.5) / kScenes);
    photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / mor, random);
    const float glare = static_cast<float>((0.05 + 0.2 * uniform(random)) * image.radiance.at(160, 100));
    for (float& value : image.radiance.pixels) value += glare;
    for (int y = 0; y < 52; ++y)
      for (int x = 0; x < image.mask.width_px; ++x) image.mask.at(x, y) |= photometry::kSaturated;
    const Observation o = measure(scene, image).observation;
    EXPECT_TRUE(o.quality.has(Quality::sun_in_picture));
    held += holds(o, mor);
  }
  std::cout << "glare: bounds held " << held << " of " << kScenes << "\n";
  EXPECT_GE(held, kScenes * 9 / 10);
}

// All targets white: no single one is odd.
TEST(ContrastDay, SnowOnAllTargetsIsToldFromFog) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(14);
  std::uniform_real_distribution<double> uniform;
  int flagged = 0, held = 0;
  constexpr int kScenes = 40;
  for (int i = 0; i < kScenes; ++i) {
    const double mor = 2000 * std::pow(5.0, (i + 0.5) / kScenes), sigma = kMorTimesExtinction / mor;
    photometry::RadianceImage image = draw_day(scene, sigma, random);
    const double depth = 0.55 + 0.25 * uniform(random);
    for (size_t t = 0; t < 4; ++t) {
      const Target& box = scene.site.targets[t];
      const double airlight = image.radiance.at(static_cast<int>(box.x_px), static_cast<int>(box.y_px) - 10);
      const double transmission = std::exp(-sigma * scene.distances_m[t]),
                   own = depth * (0.9 + 0.2 * uniform(random));
      for (int y = static_cast<int>(box.y_px) + 4; y < static_cast<int>(box.y_px + box.height_px); ++y)
        for (int x = static_cast<int>(box.x_px); x < static_cast<int>(box.x_px + box.width_px); ++x)
          image.radiance.at(x, y) += static_cast<float>(airlight * transmission * (own - 0.08));
    }
    const Observation o = measure(scene, image).observation;
    flagged += o.quality.has(Quality::snow);
    held += holds(o, mor);
  }
  std::cout << "snow flagged " << flagged << ", bounds held " << held << " of " << kScenes << "\n";
  EXPECT_GE(flagged, kScenes * 9 / 10);
  EXPECT_GE(held, kScenes * 9 / 10);
}

TEST(ContrastDay, FogIsNotTakenForSnow) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(15);
  for (int i = 0; i < 40; ++i) {
    const double mor = 50 * std::pow(100.0, (i + 0.5) / 40);
    EXPECT_FALSE(measure(scene, draw_day(scene, kMorTimesExtinction / mor, random))
                     .observation.quality.has(Quality::snow))
        << mor;
  }
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
