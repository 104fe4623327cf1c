#include <gtest/gtest.h>

#include "estimator/photometry/lamps.h"
#include "estimator/photometry/overlay.h"
#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

// Five pictures of a shaken camera: six lamps, a car on its way, one lamp that is on twice, a hot pixel
// blurred by the camera's own processing (so that it can't be told in one frame).
TEST(Survey, TellsLampsFromCarsAndHotPixels) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal(0, 1);
  const Camera camera = scene::camera_12_bit(240, 160);
  std::vector<std::vector<DetectedLight>> frames;
  for (int f = 0; f < 6; ++f) {
    const double dx = f == 0 ? 0 : 2.5 * normal(random), dy = f == 0 ? 0 : 2.5 * normal(random);
    Image<double> truth(240, 160, 40.0);
    for (int i = 0; i < 6; ++i)
      scene::add_lamp(truth, {25.0 + 36 * i + dx, 60.0 + 9 * i + dy, 8000.0 + 2000 * i, 0.9, 0.01, 8});
    scene::add_lamp(truth, {30.0 + 30 * f, 130, 30000, 1.2});
    if (f == 1 || f == 4) scene::add_lamp(truth, {120 + dx, 20 + dy, 9000, 0.9});
    scene::add_lamp(truth, {200.5, 30.5, 6000, 0.7, 0, 8});  // stays on its pixel
    frames.push_back(detect_lights(to_radiance(scene::bracket(truth, camera, {1}, random), camera)));
  }
  const Survey survey = survey_lights(frames);
  ASSERT_EQ(survey.lamps.size(), 6U);
  for (const SurveyedLight& lamp : survey.lamps) {
    const int i = static_cast<int>(std::lround((lamp.light.x_px - 25) / 36));
    EXPECT_NEAR(lamp.light.x_px, 25 + 36 * i, 0.1);
    EXPECT_NEAR(lamp.light.y_px, 60 + 9 * i, 0.1);
    EXPECT_EQ(lamp.frames_seen, 6);
    EXPECT_LT(lamp.flux_rel_scatter, 0.1);
  }
  ASSERT_EQ(survey.hot_pixels.size(), 1U);
  EXPECT_EQ(survey.hot_pixels[0], (PixelIndex{200, 30}));
  EXPECT_EQ(survey.moving.size(), 7U) << "the car in six places, the lamp that was mostly off";
}

TEST(Survey, OfOneFrameTakesAllLightsForLamps) {
  std::mt19937_64 random(2);
  const Camera camera = scene::camera_12_bit(100, 100);
  Image<double> truth(100, 100, 40.0);
  scene::add_lamp(truth, {30, 30, 9000});
  scene::add_lamp(truth, {70, 60, 90000});
  const std::vector<std::vector<DetectedLight>> frames{
      detect_lights(to_radiance(scene::bracket(truth, camera, {1}, random), camera))};
  const Survey survey = survey_lights(frames);
  ASSERT_EQ(survey.lamps.size(), 2U);
  EXPECT_NEAR(survey.lamps[0].light.x_px, 70, 0.1) << "brightest first";
}

TEST(Overlay, BandOfTextIsFoundAndDarkSkyIsNot) {
  const Camera camera = scene::camera_8_bit_srgb(200, 150);
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal(0, 1);
  Image<std::uint16_t> picture(200, 150);
  for (auto& dn : picture.pixels)
    dn = static_cast<std::uint16_t>(std::clamp(60 + 10 * normal(random), 0.0, 255.0));
  EXPECT_EQ(find_overlay(picture, camera).top, 0);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 200; ++x)
      picture.at(x, y) = y > 2 && y < 10 && x < 80 && x % 3 == 0 ? 255 : static_cast<std::uint16_t>(x % 2);
  EXPECT_EQ(find_overlay(picture, camera).top, 13);
  EXPECT_EQ(find_overlay(picture, camera).bottom, 0);
  for (auto& dn : picture.pixels) dn = dn < 200 ? dn % 3 : dn;  // dark all over
  EXPECT_EQ(find_overlay(picture, camera).top, 0);
}

}  // namespace
}  // namespace lampglow::photometry
