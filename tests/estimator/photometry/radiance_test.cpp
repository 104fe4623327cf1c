#include "estimator/photometry/radiance.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "estimator/photometry/response.h"
#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

using ::testing::HasSubstr;

// sRGB: points of IEC 61966-2-1 that can be worked out by hand.
TEST(Response, SrgbIsTheStandardsCurve) {
  EXPECT_DOUBLE_EQ(srgb_to_linear(0), 0);
  EXPECT_DOUBLE_EQ(srgb_to_linear(1), 1);
  EXPECT_NEAR(srgb_to_linear(0.5), 0.21404114, 1e-8);
  EXPECT_NEAR(srgb_to_linear(10.0 / 255), 10.0 / 255 / 12.92, 1e-12);
  for (int dn = 0; dn <= 255; ++dn) EXPECT_NEAR(linear_to_srgb(srgb_to_linear(dn / 255.0)), dn / 255.0, 1e-7);
}

TEST(Response, TablesRunFromBlackToSaturation) {
  Camera camera = scene::camera_12_bit(4, 4);
  EXPECT_FLOAT_EQ(linear_table(camera)[64], 0);
  EXPECT_FLOAT_EQ(linear_table(camera)[4095], 4031);
  EXPECT_FLOAT_EQ(linear_table(camera)[60], -4);
  camera.response.kind = Response::Kind::curve;
  camera.response.curve.resize(4096);
  for (size_t dn = 0; dn < 4096; ++dn) camera.response.curve[dn] = 3.0 + 1e-4 * static_cast<double>(dn * dn);
  const auto table = linear_table(camera);
  EXPECT_FLOAT_EQ(table[64], 0);
  EXPECT_FLOAT_EQ(table[4095], 4031);
  EXPECT_NEAR(table[2000], 4031.0 * (2000.0 * 2000 - 64 * 64) / (4095.0 * 4095 - 64 * 64), 1e-2);
}

TEST(Response, NamesWhatIsWrong) {
  Camera camera = scene::camera_12_bit(4, 4);
  camera.bit_depth = 20;
  EXPECT_THAT(camera_fault(camera), HasSubstr("camera.bit_depth = 20"));
  camera = scene::camera_12_bit(4, 4);
  camera.black_level_dn = 5000;
  EXPECT_THAT(camera_fault(camera), HasSubstr("black_level_dn"));
  camera = scene::camera_12_bit(4, 4);
  camera.response.kind = Response::Kind::curve;
  camera.response.curve.assign(256, 1.0);
  EXPECT_THAT(camera_fault(camera), HasSubstr("must have 4096"));
  camera.response.curve.assign(4096, 1.0);
  EXPECT_THAT(camera_fault(camera), HasSubstr("must rise"));
}

// A ramp of signal over five decades, from a tenth of an electron in the longest exposure to beyond what the
// shortest can hold. Columns have the same truth, so each gives a mean and a scatter of its own.
Image<double> ramp(int width, int height) {
  Image<double> truth(width, height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) truth.at(x, y) = std::pow(10.0, -1 + 5.0 * x / (width - 1));
  return truth;
}

TEST(Radiance, MergeIsUnbiasedAndItsVarianceIsRight) {
  constexpr int kWidth = 120, kHeight = 3000;
  std::mt19937_64 random(1);
  const Camera camera = scene::camera_12_bit(kWidth, kHeight);
  const Image<double> truth = ramp(kWidth, kHeight);
  const RadianceImage image = to_radiance(scene::bracket(truth, camera, {8, 1, 0.125}, random), camera,
                                          {.bloom_radius_px = 0, .find_hot_pixels = false});
  EXPECT_FALSE(image.relative);
  EXPECT_DOUBLE_EQ(image.longest_s, 8);
  for (int x = 0; x < kWidth; ++x) {
    const double expected = 0.269 * truth.at(x, 0);
    double sum = 0, squares = 0, variance = 0;
    for (int y = 0; y < kHeight; ++y) {
      ASSERT_EQ(image.mask.at(x, y), 0);
      const double value = image.radiance.at(x, y);
      sum += value / kHeight;
      squares += (value - expected) * (value - expected) / kHeight;
      variance += image.variance.at(x, y) / kHeight;
    }
    const double standard_error = std::sqrt(squares / kHeight);
    // Unbiased within 4 standard errors and a quarter percent (selection at the edge of saturation).
    EXPECT_NEAR(sum, expected, 4 * standard_error + 0.0025 * expected) << "column " << x;
    // chi² per pixel; a variance's own error is sqrt(2/3000) = 2.6 %, and kurtosis at few electrons.
    EXPECT_NEAR(squares / variance, 1, 0.16) << "column " << x << " expected " << expected;
  }
}

// The merge must be worth it: near the best possible variance, that of all exposures with ideal weights.
TEST(Radiance, MergeReachesTheBestVariance) {
  constexpr int kSize = 200;
  std::mt19937_64 random(2);
  const Camera camera = scene::camera_12_bit(kSize, kSize);
  for (const double electrons_per_s : {1.0, 10.0, 100.0, 1000.0}) {
    const Image<double> truth(kSize, kSize, electrons_per_s);
    const std::vector<double> times{8, 1, 0.125};
    const RadianceImage image =
        to_radiance(scene::bracket(truth, camera, times, random), camera, {.find_hot_pixels = false});
    double information = 0;
    for (const double t : times)
      information += t * t / (0.269 * 0.269 * electrons_per_s * t + 0.64 + 1.0 / 12);
    double squares = 0;
    for (const float value : image.radiance.pixels) squares += std::pow(value - 0.269 * electrons_per_s, 2);
    EXPECT_LT(squares / (kSize * kSize) * information, 1.05) << electrons_per_s;
  }
}

TEST(Radiance, SaturatedPixelsAreSavedByTheShorterExposure) {
  std::mt19937_64 random(3);
  const Camera camera = scene::camera_12_bit(20, 20);
  Image<double> truth(20, 20, 50.0);
  truth.at(10, 10) = 40000;    // saturates at 8 s, not at 0.125 s
  truth.at(4, 4) = 4'000'000;  // saturates always
  const RadianceImage image =
      to_radiance(scene::bracket(truth, camera, {0.125, 8}, random), camera, {.find_hot_pixels = false});
  EXPECT_EQ(image.mask.at(10, 10), 0);
  EXPECT_NEAR(image.radiance.at(10, 10), 0.269 * 40000, 5 * std::sqrt(image.variance.at(10, 10)));
  EXPECT_EQ(image.mask.at(4, 4), kSaturated);
  EXPECT_TRUE(std::isinf(image.variance.at(4, 4)));
  EXPECT_LE(image.radiance.at(4, 4), 0.269 * 4'000'000);
  EXPECT_NEAR(image.saturation_radiance, 0.98 * 4031 / 0.125, 10);
  EXPECT_EQ(image.mask.at(5, 4), kBloom);
  EXPECT_TRUE(std::isfinite(image.variance.at(5, 4)));
  EXPECT_EQ(image.mask.at(6, 4), 0);
}

TEST(Radiance, UnknownExposureIsRelativeAndFlagged) {
  std::mt19937_64 random(4);
  const Camera camera = scene::camera_12_bit(20, 20);
  Bracket bracket = scene::bracket(Image<double>(20, 20, 100.0), camera, {1}, random);
  bracket.exposures[0].exposure_s.reset();
  const RadianceImage image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.relative);
  EXPECT_TRUE(image.quality.has(Quality::automatic_exposure));
}

TEST(Radiance, BadFramesAreFlaggedInWordsAndTheRestIsUsed) {
  std::mt19937_64 random(5);
  const Camera camera = scene::camera_12_bit(20, 20);
  Bracket bracket = scene::bracket(Image<double>(20, 20, 100.0), camera, {8, 1}, random);
  bracket.exposures[0].pixels = Image<std::uint16_t>(10, 20, 100);
  RadianceImage image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.quality.has(Quality::frame_wrong_size));
  EXPECT_THAT(image.fault, HasSubstr("10x20 pixels, expected 20x20"));
  EXPECT_DOUBLE_EQ(image.longest_s, 1);
  EXPECT_FALSE(image.empty());

  bracket.exposures[1].pixels = Image<std::uint16_t>(20, 20, 7);
  image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.empty());
  EXPECT_TRUE(image.quality.has(Quality::frame_blank));

  bracket.exposures[1].pixels.at(3, 3) = 60000;
  image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.quality.has(Quality::frame_wrong_depth));
  EXPECT_THAT(image.fault, HasSubstr("value 60000, expected at most 4095"));
  EXPECT_TRUE(to_radiance(Bracket{}, camera).empty());
}

// In fog by day a bracket's long exposures are white all over: no fault, as long as a shorter one is not.
TEST(Radiance, WhiteExposuresAreLeftOutWithoutAFault) {
  std::mt19937_64 random(5);
  const Camera camera = scene::camera_12_bit(20, 20);
  Bracket bracket = scene::bracket(Image<double>(20, 20, 100.0), camera, {8, 1}, random);
  bracket.exposures[0].pixels = Image<std::uint16_t>(20, 20, 4095);
  RadianceImage image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.quality.empty());
  EXPECT_TRUE(image.fault.empty());
  EXPECT_DOUBLE_EQ(image.longest_s, 1);

  bracket.exposures[1].pixels = bracket.exposures[0].pixels;
  image = to_radiance(bracket, camera);
  EXPECT_TRUE(image.empty());
  EXPECT_TRUE(image.quality.has(Quality::frame_blank));
  EXPECT_THAT(image.fault, HasSubstr("every pixel is saturated"));
}

// 8-bit sRGB: means come out linear, and the claimed variance covers what quantisation does.
TEST(Radiance, SrgbPicturesBecomeLinear) {
  constexpr int kSize = 100;
  std::mt19937_64 random(6);
  const Camera camera = scene::camera_8_bit_srgb(kSize, kSize);
  constexpr double kGain = 0.05, kRead = 0.5;
  for (const double signal_dn : {5.0, 20.0, 60.0, 150.0}) {
    const Image<double> truth(kSize, kSize, signal_dn / kGain);
    Bracket bracket;
    bracket.exposures.push_back(scene::expose(truth, camera, 1, kGain, kRead, random));
    const RadianceImage image = to_radiance(bracket, camera, {.find_hot_pixels = false});
    double sum = 0, squares = 0, variance = 0;
    for (size_t i = 0; i < image.radiance.pixels.size(); ++i) {
      sum += image.radiance.pixels[i];
      squares += std::pow(image.radiance.pixels[i] - signal_dn, 2);
      variance += image.variance.pixels[i];
    }
    EXPECT_NEAR(sum / (kSize * kSize), signal_dn, 0.01 * signal_dn);
    EXPECT_LT(squares / variance, 1.3) << signal_dn;   // not too sure of itself
    EXPECT_GT(squares / variance, 0.25) << signal_dn;  // compression's part is not in this scene
  }
}

TEST(Noise, UnknownReadNoiseAndGainAreMeasured) {
  std::mt19937_64 random(7);
  Camera camera = scene::camera_12_bit(256, 256);
  Image<double> truth(256, 256);
  for (int y = 0; y < 256; ++y)
    for (int x = 0; x < 256; ++x) truth.at(x, y) = 20 + 4000 * std::exp(-0.5 * (x * x + y * y) / 8100.0);
  camera.gain_dn_per_electron = 0.8, camera.read_noise_dn = 3;
  const Bracket bracket = scene::bracket(truth, camera, {1}, random);
  camera.gain_dn_per_electron.reset(), camera.read_noise_dn.reset();
  const NoiseModel noise = noise_model(bracket.exposures[0], camera, linear_table(camera));
  EXPECT_TRUE(noise.measured);
  // At signal x the variance counts, not the two apart.
  for (const double dn : {20.0, 300.0, 2000.0}) {
    const double claimed = noise.gain_dn_per_electron * dn + noise.read_noise_dn * noise.read_noise_dn;
    EXPECT_NEAR(claimed / (0.8 * dn + 9), 1, 0.35) << dn;
  }
}

TEST(Radiance, VignettingIsDividedOut) {
  std::mt19937_64 random(8);
  const Camera camera = scene::camera_12_bit(40, 40);
  Image<float> map(40, 40, 0.5F);
  map.at(0, 0) = 0;
  RadianceOptions options{.find_hot_pixels = false};
  const Bracket bracket = scene::bracket(Image<double>(40, 40, 1000.0), camera, {1}, random);
  const RadianceImage plain = to_radiance(bracket, camera, options);
  options.vignetting = map;
  const RadianceImage even = to_radiance(bracket, camera, options);
  EXPECT_FLOAT_EQ(even.radiance.at(7, 9), 2 * plain.radiance.at(7, 9));
  EXPECT_FLOAT_EQ(even.variance.at(7, 9), 4 * plain.variance.at(7, 9));
  EXPECT_EQ(even.mask.at(0, 0), kInvalid);
  options.vignetting = Image<float>(3, 3, 1.0F);
  EXPECT_THROW(to_radiance(bracket, camera, options), std::invalid_argument);
}

}  // namespace
}  // namespace lampglow::photometry
