// A webcam with exposure and gain controls on the kernel's USB bus, driven by its uvcvideo. Only within
// run_vm's machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "daemon/sources/fault.h"
#include "tests/vm/usb_fixture.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

TEST_F(Uvc, BracketIsLockedReadBackRecordedAndSeenInThePictures) {
  plug();
  const auto camera = open_source(source({{0.002, {}}, {0.02, {}}, {0.2, {}}}));
  const SourceInfo info = camera->describe({});
  EXPECT_EQ(info.locked, std::optional(true));
  EXPECT_EQ(info.bit_depth, std::optional(12));
  EXPECT_DOUBLE_EQ(info.exposure_min_s.value(), 1e-4);
  EXPECT_DOUBLE_EQ(info.exposure_max_s.value(), 0.5);
  for (const std::string& control : info.controls) std::printf("%s\n", control.c_str());
  const auto bracket = camera->next({});
  ASSERT_TRUE(bracket);
  EXPECT_FALSE(bracket->quality.has(Quality::camera_not_locked)) << bracket->fault;
  ASSERT_EQ(bracket->exposures.size(), 3u);
  const double wanted_s[] = {0.002, 0.02, 0.2};
  for (std::size_t i = 0; i < 3; ++i) {
    const Exposure& exposure = bracket->exposures[i];
    ASSERT_TRUE(exposure.exposure_s);
    EXPECT_NEAR(*exposure.exposure_s, wanted_s[i], 1e-9);
    EXPECT_EQ(exposure.gain_db, std::optional(0.0));
    EXPECT_TRUE(exposure.monochrome);
    // Sky and the lamp's glow over it, in the camera's own electrons: between the sky alone and half more.
    const double sky_dn = 4e3 * wanted_s[i] / UsbCamera::kElectronsPerDn;
    std::printf("%.4f s: median %.0f DN, core %.0f DN\n", wanted_s[i], median_dn(exposure),
                core_dn(exposure));
    EXPECT_GT(median_dn(exposure) - UsbCamera::kBlack_dn, sky_dn - 2);
  }
  const auto over_black = [](double dn) { return dn - UsbCamera::kBlack_dn; };
  EXPECT_NEAR(over_black(median_dn(bracket->exposures[2])) / over_black(median_dn(bracket->exposures[1])), 10,
              1);
}

TEST_F(Uvc, CameraThatRefusesToLockIsFlaggedInEveryFrame) {
  plug({.lock = UsbLock::refuses});
  const auto camera = open_source(source({{0.01, {}}}));
  EXPECT_EQ(camera->describe({}).locked, std::optional(false));
  for (int i = 0; i < 2; ++i) {
    const auto bracket = camera->next({});
    ASSERT_TRUE(bracket);
    EXPECT_TRUE(bracket->quality.has(Quality::camera_not_locked));
    EXPECT_NE(bracket->fault.find("not_locked: exposure would not lock"), std::string::npos)
        << bracket->fault;
    EXPECT_FALSE(bracket->exposures.at(0).exposure_s) << "an exposure that is not held is not known";
  }
}

TEST_F(Uvc, CameraThatOnlySaysItLocksIsBetrayedByItsPictures) {
  plug({.lock = UsbLock::ignores});
  const auto camera = open_source(source({{0.002, {}}, {0.02, {}}}));
  const auto bracket = camera->next({});
  ASSERT_TRUE(bracket);
  EXPECT_TRUE(bracket->quality.has(Quality::camera_not_locked));
  EXPECT_NE(bracket->fault.find("do not follow the exposure"), std::string::npos) << bracket->fault;
  for (const Exposure& exposure : bracket->exposures) EXPECT_FALSE(exposure.exposure_s);
}

double share(double dn) {
  return (dn - UsbCamera::kBlack_dn) / (UsbCamera::kFull_dn - UsbCamera::kBlack_dn);
}

// What the issue wants of a bracket: the lamp's core unsaturated in the shortest, the sky above the noise in
// the longest.
bool serves(const Bracket& bracket) {
  if (bracket.exposures.empty()) return false;
  const Exposure &shortest = bracket.exposures.front(), &longest = bracket.exposures.back();
  const double core = share(core_dn(shortest)), sky_dn = median_dn(longest) - UsbCamera::kBlack_dn;
  const double noise_dn =  // the sensor's own: photons and read noise
      std::hypot(std::sqrt(std::max(sky_dn, 0.0) / UsbCamera::kElectronsPerDn), UsbCamera::kReadNoise_dn);
  return core > 0.1 && core < 0.95 && sky_dn > 5 * noise_dn && share(median_dn(longest)) < 0.6;
}

TEST_F(Uvc, BracketFollowsLampAndSky) {
  plug();
  AdaptOptions adapt;
  adapt.exposure_min_s = 1e-4;
  adapt.exposure_max_s = 0.5;
  adapt.black_level_dn = UsbCamera::kBlack_dn;
  adapt.saturation_dn = UsbCamera::kFull_dn;
  const Watched camera(source({{0.02, {}}}), adapt, 1s);  // saturated, and the sky is lost in it
  for (const auto& [lamp, sky] : {std::pair{4e6, 4e3}, {4e7, 2e3}, {4e5, 4e4}}) {
    camera_->set_light(lamp, sky);
    const int before = camera.good();
    // After the new light's first picture the old bracket may still fit by chance: two pictures at least.
    ASSERT_TRUE(eventually(60s, [&] { return camera.good() >= before + 2 && serves(camera.last()); }));
    const Bracket bracket = camera.last();
    std::printf(
        "lamp %g, sky %g electrons/s: after %d pictures %zu exposures, %.4f s (core %.2f) to %.4f s (sky "
        "%.0f DN)\n",
        lamp, sky, camera.good() - before, bracket.exposures.size(), *bracket.exposures.front().exposure_s,
        share(core_dn(bracket.exposures.front())), *bracket.exposures.back().exposure_s,
        median_dn(bracket.exposures.back()) - UsbCamera::kBlack_dn);
  }
}

TEST_F(Uvc, PulledOutAndPluggedInAgain) {
  plug();
  SourceOptions options = source({{0.005, {}}});
  options.stay_connected = true;
  const Watched camera(options, std::nullopt, 1s);
  ASSERT_TRUE(eventually(30s, [&] { return camera.good() >= 2; })) << to_string(camera.fault());
  camera_.reset();
  const auto gone = [&] {
    return camera.fault() == Fault::device_unplugged || camera.fault() == Fault::device_missing;
  };
  ASSERT_TRUE(eventually(10s, gone)) << to_string(camera.fault());
  plug();
  EXPECT_EQ("v4l2:" + uvc_device(), options.url);
  const int before = camera.good();
  const auto back = std::chrono::steady_clock::now();
  EXPECT_TRUE(eventually(20s, [&] { return camera.good() > before && camera.fault() == Fault::none; }));
  std::printf("a picture %.1f s after the camera was there again\n",
              std::chrono::duration<double>(std::chrono::steady_clock::now() - back).count());
}

}  // namespace
}  // namespace lampglow::testing
