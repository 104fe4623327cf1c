// Every flag that a night frame's estimate can carry, each from a frame that deserves it: pictures with real
// photon statistics through the whole pipeline. The day's flags are in inference/contrast_test.cpp, the
// files' in tests/daemon/sources.
#include <gtest/gtest.h>

#include <random>

#include "estimator/learn_reference.h"
#include "tests/estimator/photometry/scene.h"

namespace lampglow {
namespace {

namespace scene = photometry::scene;

constexpr int kWidth = 240, kHeight = 160;
constexpr double kSky = 60;  // electrons a second and pixel

struct Street {
  std::vector<scene::Lamp> lamps{{40, 60, 4e6}, {95, 110, 3e6}, {150, 50, 2.5e6}, {205, 100, 2e6}};
  double sky = kSky;
  double right_px = 0;  // the camera's turn
};

ClearBrackets given(const std::vector<Bracket>& clear) {
  return {clear.size(), [&clear](std::size_t i) { return clear[i]; }};
}

class Flags : public ::testing::Test {
 protected:
  Flags() {
    site_.camera = scene::camera_12_bit(kWidth, kHeight);
    site_.camera.focal_length_px = 300;
    site_.camera.principal_x_px = kWidth / 2.0;
    site_.camera.principal_y_px = kHeight / 2.0;
    double distance_m = 80;
    for (const scene::Lamp& lamp : Street().lamps) {
      site_.lights.push_back(
          {"L" + std::to_string(site_.lights.size() + 1), lamp.x_px, lamp.y_px, distance_m, {}});
      distance_m *= 2;
    }
    const std::vector<Bracket> clear{take(Street()), take(Street())};
    reference_ = learn_reference(given(clear), site_, options_);
    EXPECT_TRUE(reference_);
  }

  Bracket take(const Street& street, const std::vector<double>& times_s = {0.002, 0.05, 1}) {
    Image<double> truth(kWidth, kHeight);
    for (double& pixel : truth.pixels) pixel = street.sky;
    for (scene::Lamp lamp : street.lamps) {
      lamp.x_px += street.right_px;
      scene::add_lamp(truth, lamp);
    }
    Bracket bracket = scene::bracket(truth, site_.camera, times_s, random_);
    bracket.time_utc = parse_time_utc("2026-01-15T22:00:00Z").value();
    return bracket;
  }

  FrameResult estimated(const Bracket& bracket) const {
    return estimate(bracket, site_, reference_, options_);
  }
  bool flagged(const Bracket& bracket, Quality flag) const {
    const FrameResult result = estimated(bracket);
    return result.observation.quality.has(flag);
  }

  std::mt19937_64 random_{7};
  Site site_;
  EstimatorOptions options_;
  std::optional<ClearReference> reference_;
};

TEST_F(Flags, AClearFrameHasALimitAndNoComplaint) {
  const FrameResult result = estimated(take(Street()));
  EXPECT_TRUE(result.observation.quality.has(Quality::limit_above)) << result.observation.quality.to_string();
  for (const Quality complaint : {Quality::camera_moved, Quality::moving_lights, Quality::at_bound,
                                  Quality::lights_missing, Quality::not_registered, Quality::poor_fit,
                                  Quality::gain_drift, Quality::saturated, Quality::few_lights})
    EXPECT_FALSE(result.observation.quality.has(complaint)) << result.observation.quality.to_string();
}

TEST_F(Flags, WhatTheSiteDoesNotTell) {
  const Bracket bracket = take(Street());
  const auto with = [&](const Site& site, const std::optional<ClearReference>& reference) {
    return estimate(bracket, site, reference, options_).observation.quality;
  };
  EXPECT_TRUE(with(site_, {}).has(Quality::no_reference));
  Site dark = site_, unmeasured = site_, unscaled = site_;
  dark.lights.clear();
  EXPECT_TRUE(with(dark, reference_).has(Quality::no_lights));
  for (Light& light : unmeasured.lights) light.distance_m.reset();
  EXPECT_TRUE(with(unmeasured, reference_).has(Quality::unknown_distance));
  unscaled.camera.focal_length_px.reset();
  EXPECT_TRUE(with(unscaled, {}).has(Quality::no_angular_scale));
}

TEST_F(Flags, ACameraThatWasTurned) {
  Street turned;
  turned.right_px = 9;
  EXPECT_TRUE(flagged(take(turned), Quality::camera_moved));
  turned.right_px = 4;  // wind
  EXPECT_FALSE(flagged(take(turned), Quality::camera_moved));
}

TEST_F(Flags, NoLampAtAll) {
  Street empty;
  empty.lamps.clear();
  const FrameResult result = estimated(take(empty));
  EXPECT_TRUE(result.observation.quality.has(Quality::no_lamp_visible))
      << result.observation.quality.to_string();
  EXPECT_TRUE(result.observation.quality.has(Quality::not_registered));
}

TEST_F(Flags, LampsThatAreOff) {
  Street broken;
  broken.lamps.erase(broken.lamps.begin());
  EXPECT_TRUE(flagged(take(broken), Quality::lights_missing));
  broken.lamps.erase(broken.lamps.begin());
  EXPECT_TRUE(flagged(take(broken), Quality::few_lights));
}

TEST_F(Flags, LightsOfThisFrameAlone) {
  Street busy;
  busy.lamps.push_back({120, 20, 2e6});
  const FrameResult result = estimated(take(busy));
  EXPECT_TRUE(result.observation.quality.has(Quality::stray_lights));
  EXPECT_TRUE(result.observation.quality.has(Quality::moving_lights));
}

TEST_F(Flags, ACameraThatSeesMoreThanItDid) {
  Street bright;
  for (scene::Lamp& lamp : bright.lamps) lamp.electrons_per_s *= 1.5;
  EXPECT_TRUE(flagged(take(bright), Quality::gain_drift));
}

TEST_F(Flags, CoresSaturatedInTheOnlyExposure) {
  EXPECT_TRUE(flagged(take(Street(), {1}), Quality::saturated));
}

TEST_F(Flags, AnUnknownExposure) {
  Bracket bracket = take(Street(), {0.002});
  for (Exposure& exposure : bracket.exposures) exposure.exposure_s.reset();
  EXPECT_TRUE(flagged(bracket, Quality::automatic_exposure));
}

TEST_F(Flags, AFitThatEndsEarlyOrAtItsBound) {
  const Bracket bracket = take(Street());
  EstimatorOptions narrow = options_, hasty = options_;
  narrow.night.fit.max_mor_m = 3000;  // the air is clearer
  EXPECT_TRUE(estimate(bracket, site_, reference_, narrow).observation.quality.has(Quality::at_bound));
  hasty.night.fit.max_iterations = 1;
  EXPECT_TRUE(
      estimate(bracket, site_, reference_, hasty).observation.quality.has(Quality::fit_not_converged));
}

TEST_F(Flags, ByTheSunsAltitude) {
  site_.latitude_deg = 52.1;
  site_.longitude_deg = 5.18;
  site_.lights.clear();
  Bracket bracket = take(Street());
  const auto at = [&](const char* time, Quality flag) {
    bracket.time_utc = parse_time_utc(time).value();
    return flagged(bracket, flag);
  };
  EXPECT_TRUE(at("2026-01-15T12:00:00Z", Quality::daylight));
  EXPECT_TRUE(at("2026-01-15T16:20:00Z", Quality::twilight));
  EXPECT_FALSE(at("2026-01-15T22:00:00Z", Quality::twilight));
}

// A pixel that both clear brackets show hot is masked in a frame where it is too weak to stand out.
TEST_F(Flags, HotPixelsAreKnownFromTheClearBrackets) {
  const auto with_hot = [&](double electrons_per_s) {
    Bracket bracket = take(Street());
    for (Exposure& exposure : bracket.exposures) {
      auto& pixel = exposure.pixels.at(17, 140);
      pixel = static_cast<std::uint16_t>(
          std::min(4095.0, pixel + 0.269 * electrons_per_s * *exposure.exposure_s));
    }
    return bracket;
  };
  const std::vector<Bracket> clear{with_hot(3e4), with_hot(3e4)};
  const auto reference = learn_reference(given(clear), site_, options_);
  ASSERT_TRUE(reference);
  EXPECT_EQ(reference->hot_pixels, (std::vector<photometry::PixelIndex>{{17, 140}}));
  EXPECT_TRUE(reference_->hot_pixels.empty());
}

// Brackets are read twice: a file may be gone the second time, or the run told to stop.
TEST_F(Flags, AClearBracketThatIsGoneAtTheSecondLookIsLeftOut) {
  const Bracket clear = take(Street());
  for (const int remaining : {1, 0}) {
    int loads = 0;
    const auto reference = learn_reference(
        {2, [&](std::size_t) { return ++loads <= 2 + remaining ? clear : Bracket{}; }}, site_, options_);
    EXPECT_EQ(loads, 4);
    ASSERT_EQ(reference.has_value(), remaining > 0);
    if (reference) {
      EXPECT_EQ(reference->frames, 1);
    }
  }
}

}  // namespace
}  // namespace lampglow
