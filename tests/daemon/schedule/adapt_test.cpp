#include "daemon/schedule/adapt.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace lampglow::daemon {
namespace {

// A linear 12-bit sensor looking at a sky and a lamp, with shot and read noise.
class Scene {
 public:
  double sky_dn_per_s = 40, lamp_dn_per_s = 400'000;

  Bracket take(const std::vector<ExposureSetting>& settings) {
    Bracket bracket;
    for (const auto& setting : settings) bracket.exposures.push_back(expose(setting));
    return bracket;
  }

 private:
  Exposure expose(const ExposureSetting& setting) {
    Exposure exposure{"", setting.exposure_s, setting.gain_db, Image<std::uint16_t>(160, 120), true};
    for (int row = 0; row < 120; ++row) {
      for (int column = 0; column < 160; ++column) {
        const bool lamp = std::hypot(column - 80, row - 60) < 3;
        exposure.pixels.at(column, row) = pixel((lamp ? lamp_dn_per_s : sky_dn_per_s) * setting.exposure_s);
      }
    }
    return exposure;
  }
  std::uint16_t pixel(double mean_dn) {
    std::normal_distribution<double> noise(64 + mean_dn, std::sqrt(mean_dn * 0.27 + 0.64));
    return static_cast<std::uint16_t>(std::clamp(std::lround(noise(random_)), 0L, 4095L));
  }
  std::mt19937 random_{3};
};

const AdaptOptions kTwelveBit{
    .exposure_min_s = 1e-4, .exposure_max_s = 4, .black_level_dn = 64, .saturation_dn = 4095};

std::vector<ExposureSetting> settle(Scene& scene, std::vector<ExposureSetting> bracket, int rounds) {
  for (int i = 0; i < rounds; ++i) bracket = adapt_bracket(bracket, scene.take(bracket), kTwelveBit);
  return bracket;
}

void expect_good(Scene& scene, const std::vector<ExposureSetting>& bracket) {
  // The scene's own rates tell what is right, not the function's statistics.
  EXPECT_LT(scene.lamp_dn_per_s * bracket.front().exposure_s, 0.9 * 4031);
  const double sky_dn = scene.sky_dn_per_s * bracket.back().exposure_s;
  EXPECT_GT(sky_dn, 4 * std::sqrt(sky_dn * 0.27 + 0.64));
  for (std::size_t i = 1; i < bracket.size(); ++i) {
    EXPECT_LE(bracket[i].exposure_s / bracket[i - 1].exposure_s, 8.01);
  }
}

TEST(Adapt, FindsTheBracketFromFarOff) {
  for (const double start_s : {1e-4, 0.03, 4.0}) {
    Scene scene;
    expect_good(scene, settle(scene, {{start_s, {}}}, 12));
  }
}

TEST(Adapt, SteadySceneKeepsItsSettings) {
  Scene scene;
  const auto settled = settle(scene, {{0.01, {}}}, 12);
  EXPECT_EQ(settle(scene, settled, 5), settled);
}

TEST(Adapt, FollowsABrighterNight) {
  Scene scene;
  const auto before = settle(scene, {{0.01, {}}}, 12);
  scene.sky_dn_per_s *= 30;
  scene.lamp_dn_per_s *= 5;
  const auto after = settle(scene, before, 12);
  expect_good(scene, after);
  EXPECT_LT(after.front().exposure_s, before.front().exposure_s);
}

TEST(Adapt, UnknownExposureIsLeftAlone) {
  Scene scene;
  const std::vector<ExposureSetting> bracket{{0.01, 3.0}};
  Bracket taken = scene.take(bracket);
  taken.exposures[0].exposure_s.reset();
  EXPECT_EQ(adapt_bracket(bracket, taken, kTwelveBit), bracket);
  EXPECT_EQ(adapt_bracket(bracket, {}, kTwelveBit), bracket);
}

}  // namespace
}  // namespace lampglow::daemon
