// Lens and sensor.
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "daemon/simulation/optics.h"
#include "daemon/simulation/sensor.h"

namespace lampglow::simulation {
namespace {

double sum(const Image<double>& picture) {
  return std::accumulate(picture.pixels.begin(), picture.pixels.end(), 0.0);
}

TEST(Lens, KeepsAnEvenFieldAndAllLight) {
  const Lens lens({}, 300, 200);
  Image<double> even(300, 200, 5.0);
  lens.blur(even);
  for (const double value : even.pixels) ASSERT_NEAR(value, 5, 1e-9);
  Image<double> point(300, 200, 0.0);
  point.at(150, 100) = 1000;
  lens.blur(point);
  EXPECT_NEAR(sum(point), 1000, 1e-6);
}

// Two ways to the same picture: a lamp drawn with the formula, and a bright pixel convolved by Fourier
// transform.
TEST(Lens, PointByFormulaAndByConvolutionAgree) {
  PointSpread spread;
  Image<double> drawn(300, 240, 0.0);
  add_point(drawn, spread, 150.5, 120.5, 1000);
  Image<double> convolved(300, 240, 0.0);
  convolved.at(150, 120) = 1000;
  Lens(spread, 300, 240).blur(convolved);
  EXPECT_NEAR(drawn.at(150, 120) / convolved.at(150, 120), 1, 0.1);  // a pixel's mean against its middle
  for (const int away : {6, 8, 20, 60, 100}) {
    EXPECT_NEAR(drawn.at(150 + away, 120) / convolved.at(150 + away, 120), 1, 0.1) << away;
  }
}

TEST(Lens, GlareIsTheShareThatItSays) {
  PointSpread spread;
  double energy = 0;
  double r = 0.005;
  for (int i = 0; i < 1528; ++i, r *= 1.01)  // to 20000 px
    energy += 2 * M_PI * r * glare(spread, r) * r * 0.01 / 1.005;
  EXPECT_NEAR(energy, spread.glare_share, 0.0005);
}

TEST(Sensor, PhotonTransferCurve) {
  const Sensor sensor = bracket_sensor();
  for (const double electrons : {20.0, 500.0, 8000.0}) {
    Random random(1, {1});
    const Image<std::uint16_t> shot = expose(Image<double>(400, 400, electrons), 1, sensor, {}, random);
    double mean = 0;
    double variance = 0;
    for (const auto dn : shot.pixels) mean += dn / 160000.0;
    for (const auto dn : shot.pixels) variance += (dn - mean) * (dn - mean) / 160000.0;
    const double gain = sensor.gain_dn_per_electron;
    EXPECT_NEAR(mean, 64 + gain * electrons, 0.2) << electrons;
    const double expected = gain * gain * electrons + 0.8 * 0.8 + 1.0 / 12;
    EXPECT_NEAR(variance / expected, 1, 0.02) << electrons;
    EXPECT_NEAR(noise_variance(sensor, electrons) * gain * gain / expected, 1, 1e-9);
  }
}

TEST(Sensor, SaturatesAndHasHotPixels) {
  Random random(1, {1});
  const Image<std::uint16_t> bright = expose(Image<double>(4, 4, 1e6), 1, bracket_sensor(), {}, random);
  for (const auto dn : bright.pixels) EXPECT_EQ(dn, 4095);
  const Image<std::uint16_t> dark =
      expose(Image<double>(4, 4, 0.0), 1, bracket_sensor(), {{2, 1, 3000}}, random);
  EXPECT_GT(dark.at(2, 1), 64 + 700);
  EXPECT_LT(dark.at(1, 1), 64 + 6);
}

// 18 % grey is 46 % of the sRGB range (IEC 61966-2-1).
TEST(Sensor, WebcamWritesTheSrgbCurve) {
  Random random(1, {1});
  const Image<std::uint16_t> grey = expose(Image<double>(100, 100, 1800), 1, webcam_sensor(), {}, random);
  double mean = 0;
  for (const auto dn : grey.pixels) mean += dn / 10000.0;
  EXPECT_NEAR(mean, 117.6, 0.5);
}

}  // namespace
}  // namespace lampglow::simulation
