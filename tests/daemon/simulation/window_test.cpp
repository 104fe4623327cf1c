#include "daemon/simulation/window.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "daemon/simulation/night.h"

namespace lampglow::simulation {
namespace {

// Bright sky over dark ground, the horizon in the middle of the camera's axis.
Image<double> sky_and_ground() {
  Image<double> scene(kWidthPx, kHeightPx, 100.0);
  for (int y = kHeightPx / 2; y < kHeightPx; ++y)
    for (int x = 0; x < kWidthPx; ++x) scene.at(x, y) = 10;
  return scene;
}

TEST(Window, ADropShowsTheSceneUpsideDown) {
  const Drop drop{.y_mm = -5, .radius_mm = 3, .rim_slope = 0.9};
  const double px_per_mm = kFocalLengthPx / kWindowDistance_mm;
  const int x = kWidthPx / 2, y = static_cast<int>(kHeightPx / 2 - 5 * px_per_mm);
  const Image<double> seen = seen_through(sky_and_ground(), {drop});
  // All rays through the aperture of 2 mm then meet the drop.
  const int off_px = static_cast<int>(2 * px_per_mm);
  EXPECT_LT(seen.at(x, y - off_px), 15);  // the drop's upper part shows the ground ...
  EXPECT_GT(seen.at(x, y + off_px), 90);  // ... its lower part the sky
}

TEST(Window, TheSceneIsAsItWasBesideADropAndShinesThroughAtItsRim) {
  const Drop drop{.y_mm = -6, .radius_mm = 1, .rim_slope = 0.9};
  const double reach_mm = 1 + 0.5 * kAperture_mm, px_per_mm = kFocalLengthPx / kWindowDistance_mm;
  const Image<double> scene = sky_and_ground(), seen = seen_through(scene, {drop});
  int soft = 0;
  for (int y = 0; y < kHeightPx; ++y)
    for (int x = 0; x < kWidthPx; ++x) {
      const double away_mm =
          std::hypot(x + 0.5 - kWidthPx / 2.0, y + 0.5 - kHeightPx / 2.0 + 6 * px_per_mm) / px_per_mm;
      if (away_mm > reach_mm + 2 / px_per_mm) {
        ASSERT_NEAR(seen.at(x, y), scene.at(x, y), 1e-9) << x << " " << y;
      }
      soft += seen.at(x, y) < 98 && seen.at(x, y) > 40 && y < kHeightPx / 2 - 20;
    }
  EXPECT_GT(soft, 500);
}

TEST(Window, CoversWhatItsDropsCover) {
  const Drop round{.x_mm = 5, .radius_mm = 2},
      streaked{.x_mm = -5, .y_mm = 5, .radius_mm = 1, .streak_mm = 10};
  const double area_mm2 = kWidthPx * kHeightPx * std::pow(kWindowDistance_mm / kFocalLengthPx, 2);
  EXPECT_EQ(covered_part({}), 0);
  EXPECT_NEAR(covered_part({round}) * area_mm2, std::numbers::pi * 4, 0.3);
  EXPECT_NEAR(covered_part({round, streaked}) * area_mm2, std::numbers::pi * 5 + 20, 0.7);
}

TEST(Window, ItRainsForAPartOfTheDayAndChangesNothingElse) {
  NightOptions wet{.seed = 6, .frames = 30, .hours = Hours::day};
  wet.events.rain_on_window = true;
  const Night rain = plan_night(wet), dry = plan_night({.seed = 6, .frames = 30, .hours = Hours::day});
  int frames = 0;
  for (size_t i = 0; i < rain.frames.size(); ++i) {
    frames += !rain.frames[i].drops.empty();
    EXPECT_TRUE(dry.frames[i].drops.empty());
    EXPECT_EQ(rain.frames[i].extinction_per_m, dry.frames[i].extinction_per_m);
    EXPECT_EQ(rain.frames[i].day.target_brightness, dry.frames[i].day.target_brightness);
    if (rain.frames[i].role == FrameRole::clear_reference) {
      EXPECT_TRUE(rain.frames[i].drops.empty());
    }
  }
  EXPECT_EQ(frames, 12);
}

}  // namespace
}  // namespace lampglow::simulation
