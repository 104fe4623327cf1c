#include "daemon/simulation/daylight.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace lampglow::simulation {
namespace {

double mean(const Image<double>& picture, int x, int y, int width, int height) {
  double sum = 0;
  for (int row = y; row < y + height; ++row) {
    for (int column = x; column < x + width; ++column) sum += picture.at(column, row);
  }
  return sum / (width * height);
}

// Koschmieder's contrast C(d) = C0 exp(-σd) between a target and the sky above it.
TEST(Daylight, ContrastFallsByKoschmiedersLaw) {
  Night night = plan_night({.seed = 3, .hours = Hours::day});
  Frame& frame = night.frames[20];
  frame.shift_x_px = frame.shift_y_px = frame.rotation_rad = 0;
  frame.day.airlight = 1;
  std::fill(frame.day.path_extinction.begin(), frame.day.path_extinction.end(), 1.0);
  std::fill(frame.day.target_brightness.begin(), frame.day.target_brightness.end(), 1.0);
  auto contrast = [&](const SkylineTarget& target, double extinction_per_m) {
    frame.extinction_per_m = extinction_per_m;
    Image<double> picture(kWidthPx, kHeightPx, 0.0);
    add_skyline(picture, night, frame, 0);
    const double sky = mean(picture, target.x_px, target.y_px - 3, target.width_px, 2);
    const int rows_above_horizon = static_cast<int>(kHorizonRow) - target.y_px - 1;
    return 1 - mean(picture, target.x_px, target.y_px + 1, target.width_px, rows_above_horizon) / sky;
  };
  ASSERT_EQ(night.targets.size(), 4u);
  for (const SkylineTarget& target : night.targets) {
    const double extinction_per_m = 1.5 / target.distance_m;
    const double ratio = contrast(target, extinction_per_m) / contrast(target, 0.2 / target.distance_m);
    EXPECT_NEAR(ratio, std::exp(-1.3), 0.02) << target.id;
  }
}

TEST(Daylight, LampsBurnByNightAndTargetsStandApart) {
  const Night night = plan_night({.seed = 3, .frames = 96, .hours = Hours::both});
  EXPECT_EQ(night.references, 4);
  int by_day = 0;
  int by_night = 0;
  for (const Frame& frame : night.frames) {
    const bool lit =
        std::any_of(frame.lamp_strength.begin(), frame.lamp_strength.end(), [](double s) { return s > 0; });
    if (frame.day.sun.altitude_deg > 0) {
      EXPECT_FALSE(lit);
      ++by_day;
    }
    if (frame.day.sun.altitude_deg < -4) {
      EXPECT_TRUE(lit);
      EXPECT_LT(frame.day.horizon_electrons_per_s, 40000);
      ++by_night;
    }
  }
  EXPECT_GT(by_day, 30);
  EXPECT_GT(by_night, 30);
  for (const SkylineTarget& a : night.targets) {
    for (const SkylineTarget& b : night.targets) {
      EXPECT_TRUE(&a == &b || a.x_px + a.width_px <= b.x_px || b.x_px + b.width_px <= a.x_px);
    }
  }
}

}  // namespace
}  // namespace lampglow::simulation
