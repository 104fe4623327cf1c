// The webcam of uvc_vm_test through libcamera and its handler of USB cameras. Only within run_vm's machine.
#include <gtest/gtest.h>

#include <cstdlib>

#include "daemon/sources/fault.h"
#include "daemon/sources/image_file.h"
#include "daemon/sources/libcamera_camera.h"
#include "tests/system/chain/chain.h"
#include "tests/vm/usb_fixture.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

class Libcamera : public Uvc {
 protected:
  // libcamera hears of it from udev.
  void plug_and_find(UsbCameraOptions options = {}) {
    ASSERT_TRUE(eventually(90s, [] { return list_libcamera().empty(); })) << "the last camera is still there";
    plug(std::move(options));
    const auto found = [&] {
      const auto cameras = list_libcamera();
      if (!cameras.empty()) url_ = "libcamera:" + cameras.front().id;
      return !cameras.empty();
    };
    ASSERT_TRUE(eventually(90s, found)) << "libcamera does not see the camera";
  }
  SourceOptions through_libcamera(std::vector<ExposureSetting> bracket = {}) const {
    SourceOptions options = source(std::move(bracket));
    options.url = url_;
    options.frame_timeout = 180s;  // of an emulated machine on a busy one
    return options;
  }
  std::string url_;
};

Fault fault_of(FrameSource& source) {
  try {
    source.next({});
  } catch (const SourceError& error) {
    std::printf("%s: %s\n", std::string(to_string(error.fault())).c_str(), error.what());
    return error.fault();
  }
  return Fault::none;
}

TEST_F(Libcamera, BracketIsSetByRequestsAndSeenInThePictures) {
  plug_and_find();
  for (const LibcameraListing& one : list_libcamera()) {
    std::printf("%s, %s\n", one.id.c_str(), one.info.driver.c_str());
    for (const std::string& text : one.info.formats) std::printf("  %s\n", text.c_str());
    for (const std::string& text : one.info.controls) std::printf("  %s\n", text.c_str());
  }
  const auto camera = open_source(through_libcamera({{0.002, {}}, {0.02, {}}, {0.2, {}}}));
  const SourceInfo info = camera->describe({});
  EXPECT_EQ(info.locked, std::optional(true));
  EXPECT_EQ(info.bit_depth, std::optional(12));
  EXPECT_DOUBLE_EQ(info.exposure_min_s.value(), 1e-4);
  EXPECT_DOUBLE_EQ(info.exposure_max_s.value(), 0.5);
  const double wanted_s[] = {0.002, 0.02, 0.2};
  for (int again = 0; again < 2; ++again) {  // the second time from 0.2 s back to 0.002 s
    const auto bracket = camera->next({});
    ASSERT_TRUE(bracket);
    EXPECT_FALSE(bracket->quality.has(Quality::camera_not_locked)) << bracket->fault;
    ASSERT_EQ(bracket->exposures.size(), 3u);
    for (std::size_t i = 0; i < 3; ++i) {
      const Exposure& exposure = bracket->exposures[i];
      EXPECT_NEAR(exposure.exposure_s.value(), wanted_s[i], 1e-9);
      EXPECT_EQ(exposure.gain_db, std::optional(0.0));
      EXPECT_TRUE(exposure.monochrome);
      const double sky_dn = 4e3 * wanted_s[i] / UsbCamera::kElectronsPerDn;
      const double median = median_dn(exposure) - UsbCamera::kBlack_dn;
      std::printf("%.4f s: median %.0f DN over black, core %.0f DN\n", wanted_s[i], median,
                  core_dn(exposure));
      // Sky and the lamp's glow over it: the sky alone at least, and proportional to the exposure.
      EXPECT_GT(median, sky_dn - 2);
      if (i == 2) {
        EXPECT_NEAR(median / (median_dn(bracket->exposures[1]) - UsbCamera::kBlack_dn), 10, 1);
      }
    }
  }
}

TEST_F(Libcamera, HasAReasonForEveryFault) {
  SourceOptions options;
  options.url = "libcamera:nowhere";
  EXPECT_EQ(fault_of(*open_source(options)), Fault::device_missing);

  plug_and_find({.lock = UsbLock::refuses});  // it refuses requests with controls: pictures without
  auto camera = open_source(through_libcamera({{0.01, {}}}));
  EXPECT_EQ(camera->describe({}).locked, std::optional(false));
  const auto refused = camera->next({});
  ASSERT_TRUE(refused);
  EXPECT_TRUE(refused->quality.has(Quality::camera_not_locked));
  EXPECT_NE(refused->fault.find("exposure would not lock"), std::string::npos) << refused->fault;
  EXPECT_FALSE(refused->exposures.at(0).exposure_s) << "an exposure that is not held is not known";
  EXPECT_EQ(fault_of(*open_source(through_libcamera())), Fault::device_busy) << "the other source holds it";
  options = through_libcamera();
  camera.reset();
  options.pixel_format = "SRGGB12";
  EXPECT_EQ(fault_of(*open_source(options)), Fault::format_unsupported);
  camera_.reset();

  plug_and_find({.lock = UsbLock::ignores});
  const auto ignored = open_source(through_libcamera({{0.002, {}}, {0.02, {}}}))->next({});
  ASSERT_TRUE(ignored);
  EXPECT_TRUE(ignored->quality.has(Quality::camera_not_locked));
  EXPECT_NE(ignored->fault.find("do not follow the exposure"), std::string::npos) << ignored->fault;
  for (const Exposure& exposure : ignored->exposures) EXPECT_FALSE(exposure.exposure_s);
}

TEST_F(Libcamera, PulledOutAndPluggedInAgain) {
  plug_and_find();
  SourceOptions options = through_libcamera({{0.005, {}}});
  options.stay_connected = true;
  const Watched camera(options, std::nullopt, 1s);
  ASSERT_TRUE(eventually(120s, [&] { return camera.good() >= 2; })) << to_string(camera.fault());
  camera_.reset();
  const auto gone = [&] {
    return camera.fault() == Fault::device_unplugged || camera.fault() == Fault::device_missing;
  };
  ASSERT_TRUE(eventually(30s, gone)) << to_string(camera.fault());
  std::printf("pulled out: %s\n", std::string(to_string(camera.fault())).c_str());
  plug();
  const int before = camera.good();
  const auto back = std::chrono::steady_clock::now();
  EXPECT_TRUE(eventually(60s, [&] { return camera.good() > before && camera.fault() == Fault::none; }))
      << to_string(camera.fault());
  std::printf("a picture %.1f s after the camera was there again\n",
              std::chrono::duration<double>(std::chrono::steady_clock::now() - back).count());
}

TEST_F(Libcamera, NightThroughTheStationBitForBit) {
  const TempFolder folder;
  const Night night = replay_night(fs::path(LAMPGLOW_VM_NIGHT) / "png", folder / "replay.db");
  ASSERT_EQ(night.truth.size(), night.pictures.size());
  plug_and_find({.picture = load_plain_image(night.pictures[0]).pixels});
  const ChainStation station(folder / "station", night.archive, "url = '" + url_ + "'", 5);
  for (std::size_t i = 0; i < night.pictures.size(); ++i) {
    camera_->show(load_plain_image(night.pictures[i]).pixels);
    ASSERT_TRUE(station.stores(night.truth[i].observation, 120s));
  }
  // It has no exposure control: said of every picture.
  for (const auto& row : station.stored()) {
    if (!row.observation.extinction_per_m) continue;
    EXPECT_TRUE(row.observation.quality.has(Quality::camera_not_locked)) << row.reason;
  }
}

}  // namespace
}  // namespace lampglow::testing
