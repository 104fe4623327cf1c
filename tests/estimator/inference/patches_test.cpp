#include "estimator/inference/patches.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/estimator/inference/day_scene.h"

namespace lampglow::inference {
namespace {

using lampglow::testing::day_scene;
using lampglow::testing::DayScene;
using lampglow::testing::draw_day;

constexpr double kLeast_m = 100, kMost_m = 6000;

PatchOptions day_options() {
  PatchOptions options;
  options.texture = true;
  options.patch_px = 20;
  return options;
}

// A frame every ten minutes whose MOR wanders up and down and whose exposure is anything.
std::vector<PatchFrame> day_of(const DayScene& scene, int frames, std::mt19937_64& random) {
  std::uniform_real_distribution<double> uniform;
  std::vector<PatchFrame> result;
  for (int i = 0; i < frames; ++i) {
    const double mor = kLeast_m * std::pow(kMost_m / kLeast_m, 0.5 + 0.5 * std::sin(i * 0.7));
    photometry::RadianceImage image = draw_day(scene, kMorTimesExtinction / mor, random);
    const auto gain = static_cast<float>(0.5 + uniform(random));
    for (float& pixel : image.radiance.pixels) pixel *= gain;
    result.push_back({TimePoint{} + std::chrono::minutes(10 * i),
                      patch_features(image, scene.site.camera, 20, true),
                      std::log(kMorTimesExtinction / mor)});
  }
  return result;
}

// Textures of an even sky are lost in their floor, which does not follow the gain.
TEST(Patches, GainAndExposureCancelInTheStepsOfBrightness) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(1);
  photometry::RadianceImage image = draw_day(scene, 1e-3, random);
  const auto once = patch_features(image, scene.site.camera, 20, true);
  for (float& pixel : image.radiance.pixels) pixel *= 0.5F;
  const auto twice = patch_features(image, scene.site.camera, 20, true);
  ASSERT_EQ(once.size(), 16U * 9 + 16 * 10);
  for (size_t i = 0; i < 16 * 9; ++i) EXPECT_NEAR(once[i], twice[i], 0.02) << i;
}

TEST(Patches, ForetellFramesNeverSeenWithinTheirBounds) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(2);
  const PatchLearning learning = learn_patches(day_of(scene, 60, random), day_options());
  ASSERT_TRUE(learning.calibration) << learning.why_not;
  EXPECT_GT(learning.correlation, 0.9);
  int covered = 0, near = 0;
  constexpr int kFrames = 60;
  for (int i = 0; i < kFrames; ++i) {
    const double mor = kLeast_m * std::pow(kMost_m / kLeast_m, (i + 0.5) / kFrames);
    FrameResult result;
    measure_patches(draw_day(scene, kMorTimesExtinction / mor, random), scene.site.camera,
                    *learning.calibration, std::nullopt, Method::contrast, day_options(), result);
    const Observation& o = result.observation;
    ASSERT_TRUE(o.mor_m()) << result.reason;
    EXPECT_EQ(o.method, Method::contrast);
    near += std::abs(std::log(*o.mor_m() / mor)) < 0.35;
    covered += (!o.mor_low_m() || *o.mor_low_m() <= mor) && (!o.mor_high_m() || mor <= *o.mor_high_m());
  }
  EXPECT_GE(near, 48) << "of 60";
  EXPECT_GE(covered, 54) << "of 60";
}

TEST(Patches, SaysNothingOfAPictureUnlikeAllItLearnedFrom) {
  const DayScene scene = day_scene({150, 500, 1400, 4000});
  std::mt19937_64 random(3);
  const PatchLearning learning = learn_patches(day_of(scene, 40, random), day_options());
  ASSERT_TRUE(learning.calibration) << learning.why_not;
  photometry::RadianceImage odd = draw_day(scene, 1e-3, random);
  for (int y = 0; y < odd.radiance.height_px; ++y)
    for (int x = 0; x < odd.radiance.width_px; ++x)
      odd.radiance.at(x, y) = ((x / 20 + y / 20) % 2 != 0) ? 3000.F : 30.F;
  FrameResult result;
  measure_patches(odd, scene.site.camera, *learning.calibration, std::nullopt, Method::contrast,
                  day_options(), result);
  EXPECT_FALSE(result.observation.extinction_per_m);
  EXPECT_NE(result.reason.find("unlike"), std::string::npos);

  PatchCalibration other = *learning.calibration;
  other.patch_px = 40;
  measure_patches(odd, scene.site.camera, other, std::nullopt, Method::contrast, day_options(), result);
  EXPECT_TRUE(result.observation.quality.has(Quality::frame_wrong_size));
}

TEST(Patches, SaysWhyNothingCanBeLearned) {
  const DayScene scene = day_scene({150, 500});
  std::mt19937_64 random(4);
  std::vector<PatchFrame> frames = day_of(scene, 30, random);
  const auto few = learn_patches(std::span(frames).first(5), day_options());
  EXPECT_FALSE(few.calibration);
  EXPECT_NE(few.why_not.find("5"), std::string::npos);

  std::vector<PatchFrame> steady = frames;
  for (PatchFrame& frame : steady) frame.ln_sigma = -7;
  EXPECT_FALSE(learn_patches(steady, day_options()).calibration);

  std::shuffle(frames.begin(), frames.end(), random);  // truth that has nothing to do with the pictures
  std::vector<PatchFrame> wrong = frames;
  for (size_t i = 0; i < wrong.size(); ++i) {
    wrong[i].ln_sigma = frames[(i * 7 + 3) % frames.size()].ln_sigma;
    wrong[i].time_utc = TimePoint{} + std::chrono::minutes(10 * i);
  }
  EXPECT_FALSE(learn_patches(wrong, day_options()).calibration);
}

TEST(Patches, NightModeDecidesInTwilight) {
  Site site;
  EXPECT_FALSE(for_day_patches(30, false, site));
  site.day_patches = PatchCalibration{};
  site.day_patches->colour = true;
  EXPECT_TRUE(for_day_patches(30, false, site));
  EXPECT_FALSE(for_day_patches(30, true, site)) << "a camera stuck in night mode";
  EXPECT_TRUE(for_day_patches(-7, false, site));
  EXPECT_FALSE(for_day_patches(-12, false, site));
  EXPECT_FALSE(for_night_patches(-7, false, site));
  EXPECT_TRUE(for_night_patches(-7, true, site));
  EXPECT_TRUE(for_night_patches(-12, false, site));
}

}  // namespace
}  // namespace lampglow::inference
