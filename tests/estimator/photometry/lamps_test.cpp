#include "estimator/photometry/lamps.h"

#include <gtest/gtest.h>

#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

RadianceImage take(const Image<double>& truth, const std::vector<double>& times_s, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const Camera camera = scene::camera_12_bit(truth.width_px, truth.height_px);
  return to_radiance(scene::bracket(truth, camera, times_s, random), camera);
}

const DetectedLight* nearest(const std::vector<DetectedLight>& lights, double x, double y, double within) {
  const DetectedLight* best = nullptr;
  for (const DetectedLight& light : lights) {
    const double way = std::hypot(light.x_px - x, light.y_px - y);
    if (way < within) best = &light, within = way;
  }
  return best;
}

// The least standard deviation any estimator of x can have (Cramér-Rao, background known): 1/Σ (dI/dx)²/var.
double cramer_rao_px(const scene::Lamp& lamp, double sky, double exposure_s) {
  const double h = 1e-3;
  const int size = 31;
  Image<double> here(size, size, sky), left(size, size, sky), right(size, size, sky);
  scene::Lamp at = lamp;
  at.x_px = 15 + lamp.x_px - std::floor(lamp.x_px), at.y_px = 15 + lamp.y_px - std::floor(lamp.y_px);
  scene::add_lamp(here, at);
  at.x_px -= h;
  scene::add_lamp(left, at);
  at.x_px += 2 * h;
  scene::add_lamp(right, at);
  double information = 0;
  for (size_t i = 0; i < here.pixels.size(); ++i) {
    const double slope = exposure_s * (right.pixels[i] - left.pixels[i]) / (2 * h);
    const double variance = here.pixels[i] * exposure_s + (0.64 + 1.0 / 12) / (0.269 * 0.269);
    information += slope * slope / variance;
  }
  return 1 / std::sqrt(information);
}

struct CentroidScore {
  double rms_px = 0, bound_px = 0, pull = 0, bias_px = 0;
};

CentroidScore centroid_score(double electrons, double psf_sigma_px) {
  CentroidScore result;
  constexpr int kTrials = 200;
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> part(0, 1);
  for (int i = 0; i < kTrials; ++i) {
    const scene::Lamp lamp{32 + part(random), 32 + part(random), electrons, psf_sigma_px, 0.02, 10};
    Image<double> truth(64, 64, 30.0);
    scene::add_lamp(truth, lamp);
    const DetectedLight light = measure_light(take(truth, {1}, 1000 + static_cast<std::uint64_t>(i)), 33, 32);
    const double ex = light.x_px - lamp.x_px, ey = light.y_px - lamp.y_px;
    result.rms_px += (ex * ex + ey * ey) / 2 / kTrials;
    result.pull += (ex * ex + ey * ey) / 2 / std::pow(light.position_sigma_px, 2) / kTrials;
    result.bias_px += ex / kTrials;
    result.bound_px += std::pow(cramer_rao_px(lamp, 30, 1), 2) / kTrials;
  }
  result.rms_px = std::sqrt(result.rms_px), result.bound_px = std::sqrt(result.bound_px);
  return result;
}

TEST(Centroid, IsNearTheCramerRaoBoundAndKnowsItsError) {
  for (const double electrons : {600.0, 3000.0, 12000.0}) {
    for (const double psf : {0.7, 1.0, 1.6}) {
      const CentroidScore score = centroid_score(electrons, psf);
      RecordProperty("rms_" + std::to_string(electrons) + "_" + std::to_string(psf),
                     std::to_string(score.rms_px));
      std::printf("electrons %6.0f psf %.1f px: rms %.4f px, bound %.4f px, pull² %.2f, bias %+.4f px\n",
                  electrons, psf, score.rms_px, score.bound_px, score.pull, score.bias_px);
      EXPECT_LT(score.rms_px, 1.6 * std::hypot(score.bound_px, 0.01));
      EXPECT_GT(score.rms_px, 0.9 * score.bound_px) << "better than possible: the test is wrong";
      EXPECT_GT(score.pull, 0.3) << "0.01 px of the claim are for uneven pixels, which this scene has not";
      EXPECT_LT(score.pull, 1.7);
      EXPECT_LT(std::abs(score.bias_px), 4 * score.rms_px / std::sqrt(200.0) + 0.004);
    }
  }
}

TEST(Centroid, OfSaturatedCoresHoldsToATwentiethOfAPixel) {
  std::mt19937_64 random(6);
  std::uniform_real_distribution<double> part(0, 1);
  for (const double over : {5.0, 50.0, 500.0}) {
    double squares = 0;
    int saturated = 0;
    for (int i = 0; i < 60; ++i) {
      const scene::Lamp lamp{40 + part(random), 40 + part(random), over * 15000 * 6, 1.0, 0.02, 10};
      Image<double> truth(81, 81, 30.0);
      scene::add_lamp(truth, lamp);
      const RadianceImage image = take(truth, {1}, 2000 + static_cast<std::uint64_t>(i));
      const DetectedLight light = measure_light(image, 40.5, 40.5);
      squares += (std::pow(light.x_px - lamp.x_px, 2) + std::pow(light.y_px - lamp.y_px, 2)) / 2 / 60;
      saturated += light.saturated_pixels;
    }
    std::printf("%.0f times full well: rms %.4f px, %d saturated pixels\n", over, std::sqrt(squares),
                saturated / 60);
    EXPECT_GT(saturated / 60, 3);
    EXPECT_LT(std::sqrt(squares), 0.05) << over;
  }
}

TEST(Centroid, IsNotPulledByANeighboursHalo) {
  Image<double> truth(120, 80, 30.0);
  scene::add_lamp(truth, {40.3, 40.4, 2e6, 0.9, 0.1, 12});
  scene::add_lamp(truth, {62.7, 41.2, 2e4, 0.9, 0.02, 12});
  const DetectedLight light = measure_light(take(truth, {8, 1, 0.1}, 3), 62, 41);
  EXPECT_NEAR(light.x_px, 62.7, 0.05);
  EXPECT_NEAR(light.y_px, 41.2, 0.05);
}

TEST(Detection, FindsAllLampsAndNothingElse) {
  int wrong = 0, missed = 0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> part(0, 1);
    Image<double> truth(400, 300);
    for (int y = 0; y < 300; ++y)
      for (int x = 0; x < 400; ++x)
        truth.at(x, y) = 20 + 80.0 * y / 300 + 40 * std::exp(-std::pow((x - 200) / 80.0, 2));
    std::vector<scene::Lamp> lamps;
    lamps.reserve(20);
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 5; ++column)
        lamps.push_back({25 + column * 80 + 30 * part(random), 30 + row * 70 + 20 * part(random),
                         std::pow(10, 3 + 2 * part(random)), 0.9, 0.02, 10});
    for (const auto& lamp : lamps) scene::add_lamp(truth, lamp);
    truth.at(100, 200) += 2000;  // a hot pixel
    for (const int binning : {1, 2}) {
      const auto lights = detect_lights(take(truth, {4, 0.5}, 30 + seed), {.binning = binning});
      for (const auto& lamp : lamps) missed += nearest(lights, lamp.x_px, lamp.y_px, 0.3) == nullptr;
      for (const auto& light : lights)
        wrong += std::none_of(lamps.begin(), lamps.end(), [&](const scene::Lamp& lamp) {
          return std::hypot(lamp.x_px - light.x_px, lamp.y_px - light.y_px) < 0.3;
        });
    }
  }
  EXPECT_EQ(missed, 0) << "of 240";
  EXPECT_EQ(wrong, 0);
}

TEST(Detection, TellsNeighboursApartAndDoesNotBreakGlareToPieces) {
  Image<double> truth(160, 160, 30.0);
  scene::add_lamp(truth, {50.2, 50.7, 40000, 0.9});
  scene::add_lamp(truth, {56.1, 52.3, 15000, 0.9});  // 6 px away
  scene::add_lamp(truth, {110.5, 110.5, 3e7, 1.0});  // a large saturated core
  const auto lights = detect_lights(take(truth, {1}, 4));
  ASSERT_EQ(lights.size(), 3U);
  EXPECT_NE(nearest(lights, 50.2, 50.7, 0.2), nullptr);
  EXPECT_NE(nearest(lights, 56.1, 52.3, 0.3), nullptr);
  EXPECT_NE(nearest(lights, 110.5, 110.5, 0.1), nullptr);
  EXPECT_GT(lights[0].saturated_pixels, 10);
}

TEST(Detection, FluxIsTheLampsWithinTheApertureAndItsErrorIsRight) {
  double pull = 0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Image<double> truth(64, 64, 30.0);
    scene::add_lamp(truth, {32.3, 31.8, 8000, 0.9, 0.0, 10});
    DetectedLight light;
    measure_flux(take(truth, {1}, 500 + seed), 32.3, 31.8, 4, 3, light);
    const double error = light.flux - 0.269 * 8000;
    EXPECT_LT(std::abs(error), 0.1 * 0.269 * 8000);
    pull += error * error / (light.flux_sigma * light.flux_sigma) / 100;
  }
  EXPECT_GT(pull, 0.6);
  EXPECT_LT(pull, 1.6);
}

TEST(Background, FollowsTheSkyAndNotTheLamps) {
  Image<double> truth(256, 256);
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 256; ++x) truth.at(x, y) = 50 + 0.3 * x + 0.2 * y;
  for (int i = 0; i < 12; ++i) scene::add_lamp(truth, {20.0 + 20 * i, 128.0, 20000, 0.9, 0, 10});
  const RadianceImage image = take(truth, {4}, 9);
  const Background background({image.radiance, &image.variance, &image.mask}, 32);
  std::vector<float> level(256);
  for (int y = 16; y < 240; y += 7) {
    background.levels_of_row(y, level);
    for (int x = 16; x < 240; x += 7) {
      const double expected = 0.269 * (50 + 0.3 * (x + 0.5) + 0.2 * (y + 0.5));
      EXPECT_NEAR(level[static_cast<size_t>(x)], expected, 0.04 * expected) << x << " " << y;
    }
  }
}

}  // namespace
}  // namespace lampglow::photometry
