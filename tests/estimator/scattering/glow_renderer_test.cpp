#include "estimator/scattering/glow_renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/glow_table.h"

namespace lampglow::scattering {
namespace {

constexpr int kWidth = 1300, kHeight = 500;

RenderOptions fog() {
  RenderOptions options;
  options.medium = {0.012, 0.99, 0.85};
  options.focal_length_px = 1500;
  return options;
}

std::vector<float> dark() {
  return std::vector<float>(kWidth * kHeight);
}
std::size_t pixel(int x, int y) {
  return static_cast<std::size_t>(y * kWidth + x);
}

TEST(GlowRenderer, OneLampHasTheTablesGlowOnBothSidesOfEverySeam) {
  std::vector<float> clear = dark(), out = dark();
  const int lamp_x = 430, lamp_y = 243;
  clear[pixel(lamp_x, lamp_y)] = 1e6f;
  render_glow(clear, kWidth, kHeight, {}, 90, fog(), out);
  const double thickness = 0.012 * 90, focal = 1500;
  EXPECT_GT(out[pixel(lamp_x, lamp_y)], 1e6 * std::exp(-thickness));
  for (const int dx : {-430, -200, -90, -50, -33, -20, 20, 41, 64, 100, 130, 170, 338, 339, 500, 860})
    for (const int dy : {-120, 0, 7, 200}) {
      const double theta = std::atan(std::hypot(dx, dy) / focal);
      double single = 0, multiple = 0;
      default_glow_table().parts(thickness, 0.85, 0.99, {&theta, 1}, {&single, 1}, {&multiple, 1});
      const double expected =
          1e6 * 4 * std::numbers::pi * thickness * thickness * (single + multiple) / (focal * focal);
      EXPECT_NEAR(static_cast<double>(out[pixel(lamp_x + dx, lamp_y + dy)]) / expected, 1, 0.004)
          << dx << " " << dy;
    }
}

TEST(GlowRenderer, CentrePixelHoldsTheWholePixelsGlow) {
  // Pixels 4 times larger hold what their 16 parts hold: the kernel is a mean over the pixel, through the
  // cusp.
  RenderOptions fine = fog(), large = fog();
  large.focal_length_px = fine.focal_length_px / 4;
  const GlowKernel small(fine, 90), big(large, 90);
  double sum = 0;
  // Mean over source and receiver positions would be another thing: here a lamp in the large pixel's middle.
  for (int y = -2; y < 2; ++y)
    for (int x = -2; x < 2; ++x) sum += small.pixel(x + 0.5, y + 0.5);
  EXPECT_NEAR(sum / big.pixel(0, 0), 1, 0.03);
  EXPECT_LT(GlowKernel(
                [] {
                  RenderOptions options = fog();
                  options.single_only = true;
                  return options;
                }(),
                90)
                .pixel(0, 0),
            small.pixel(0, 0));
}

TEST(GlowRenderer, DepthAttenuatesAndAddsAirlight) {
  RenderOptions options = fog();
  options.airlight = 2;
  std::vector<float> clear = dark(), out = dark(), depth(clear.size(), 50.0f);
  for (int y = 0; y < kHeight; ++y)
    for (int x = kWidth / 2; x < kWidth; ++x) depth[pixel(x, y)] = 400.0f;
  render_glow(clear, kWidth, kHeight, depth, 1, options, out);
  EXPECT_NEAR(out[pixel(10, 10)], 2 * (1 - std::exp(-0.6)), 1e-4);
  EXPECT_NEAR(out[pixel(1290, 10)], 2 * (1 - std::exp(-4.8)), 1e-4);
}

TEST(GlowRenderer, LayersGiveEachLampItsOwnDistance) {
  std::vector<float> clear = dark(), out = dark(), alone = dark(), depth(clear.size(), 40.0f);
  clear[pixel(200, 250)] = 1e6f;
  depth[pixel(900, 250)] = 300.0f;
  RenderOptions options = fog();
  render_glow(clear, kWidth, kHeight, depth, 0, options, out);
  render_glow(clear, kWidth, kHeight, {}, 40, options, alone);
  for (const int dx : {-100, -10, 15, 60, 200, 400})
    EXPECT_NEAR(out[pixel(200 + dx, 260)] / alone[pixel(200 + dx, 260)], 1, 1e-4);
}

TEST(GlowRenderer, RefusesWhatItCannotDo) {
  std::vector<float> clear = dark(), out = dark();
  EXPECT_THROW(render_glow(clear, kWidth, kHeight, {}, 1e5, fog(), out), std::domain_error);
  EXPECT_THROW(render_glow(clear, 3, 3, {}, 90, fog(), out), std::invalid_argument);
  RenderOptions bad = fog();
  bad.focal_length_px = 0;
  EXPECT_THROW(render_glow(clear, kWidth, kHeight, {}, 90, bad, out), std::invalid_argument);
}

}  // namespace
}  // namespace lampglow::scattering
