#include "estimator/photometry/response_measurement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimator/photometry/response.h"
#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

// A night scene with a wide range of brightness: sky, glow, lit ground, lamps.
Image<double> wide_scene() {
  Image<double> truth(240, 160);
  for (int y = 0; y < 160; ++y)
    for (int x = 0; x < 240; ++x)
      truth.at(x, y) = 40 + 5e4 * std::exp(-std::hypot(x - 60, y - 80) / 18.0) +
                       8000 * std::exp(-std::hypot(x - 180, y - 60) / 30.0);
  return truth;
}

std::vector<Exposure> take(const Camera& camera, double gain) {
  std::mt19937_64 random(3);
  std::vector<Exposure> exposures;
  for (const double t : {0.0625, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0})
    exposures.push_back(scene::expose(wide_scene(), camera, t, gain, 0.1, random));
  return exposures;
}

class Methods : public ::testing::TestWithParam<ResponseMethod> {};

TEST_P(Methods, FindTheSrgbCurve) {
  const Camera camera = scene::camera_8_bit_srgb(240, 160);
  const MeasuredResponse response = measure_response(take(camera, 0.01), 8, GetParam());
  ASSERT_EQ(response.curve.size(), 256U);
  EXPECT_GT(response.samples, 200);
  EXPECT_LT(response.rms_rel, 0.05);
  EXPECT_NEAR(response.best_gamma, 2.2, 0.2);
  // The scale is free: compared where it is 1 by definition nowhere, but against the curve's value at DN 128.
  const double scale = srgb_to_linear(128 / 255.0) / response.curve[128];
  for (int dn = 20; dn <= 240; dn += 10)
    EXPECT_NEAR(scale * response.curve[static_cast<size_t>(dn)] / srgb_to_linear(dn / 255.0), 1, 0.06) << dn;
  EXPECT_TRUE(std::is_sorted(response.curve.begin(), response.curve.end()));
  EXPECT_EQ(response.curve.front(), 0);
  EXPECT_EQ(response.curve.back(), 1);
}

TEST_P(Methods, FindThatALinearCameraIsLinear) {
  Camera camera = scene::camera_12_bit(240, 160);
  camera.black_level_dn = 0;
  const MeasuredResponse response = measure_response(take(camera, 0.15), 12, GetParam());
  ASSERT_EQ(response.curve.size(), 4096U);
  EXPECT_NEAR(response.best_gamma, 1, 0.08);
  const double scale = 2048 / 4095.0 / response.curve[2048];
  for (int dn = 400; dn <= 3800; dn += 200)
    EXPECT_NEAR(scale * response.curve[static_cast<size_t>(dn)] / (dn / 4095.0), 1, 0.06) << dn;
}

INSTANTIATE_TEST_SUITE_P(ResponseMeasurement, Methods,
                         ::testing::Values(ResponseMethod::debevec, ResponseMethod::robertson));

TEST(ResponseMeasurement, SaysWhatItMisses) {
  const Camera camera = scene::camera_8_bit_srgb(240, 160);
  std::vector<Exposure> exposures = take(camera, 0.01);
  EXPECT_THROW(measure_response(std::span(exposures).first(1), 8, ResponseMethod::debevec),
               std::invalid_argument);
  exposures[1].exposure_s.reset();
  try {
    measure_response(exposures, 8, ResponseMethod::debevec);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("exposure time expected"));
  }
}

}  // namespace
}  // namespace lampglow::photometry
