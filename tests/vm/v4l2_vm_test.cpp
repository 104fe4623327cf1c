// Real Video4Linux devices of the kernel's vivid driver. Only within the virtual machine of run_vm.
#include <fcntl.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <mutex>

#include "daemon/config/descriptor.h"
#include "daemon/schedule/camera_loop.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/v4l2_device.h"
#include "tests/system/cameras/support.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

constexpr const char* kCamera = "/dev/video0";

class Vivid : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::getenv("LAMPGLOW_IN_VM") == nullptr) GTEST_SKIP() << "only within run_vm's virtual machine";
    ASSERT_TRUE(eventually(5s, [] { return fs::exists(kCamera); })) << "vivid is not there";
    set_input(0);
  }
  static Descriptor open_device(const char* path) { return Descriptor(::open(path, O_RDWR | O_CLOEXEC)); }
  static void set_input(int input) {
    const Descriptor device = open_device(kCamera);
    ASSERT_EQ(::ioctl(device.get(), VIDIOC_S_INPUT, &input), 0);
  }
  static void set(const char* path, const std::string& control, std::int32_t value) {
    const Descriptor device = open_device(path);
    v4l2_queryctrl query{};
    query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    while (::ioctl(device.get(), VIDIOC_QUERYCTRL, &query) == 0) {
      if (control == reinterpret_cast<const char*>(query.name)) {
        v4l2_control set{query.id, value};
        ASSERT_EQ(::ioctl(device.get(), VIDIOC_S_CTRL, &set), 0) << control;
        return;
      }
      query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    FAIL() << path << " has no control '" << control << "'";
  }
  // By the menu's text, so that the kernel's order does not matter.
  static void choose(const std::string& control, const std::string& entry) {
    const Descriptor device = open_device(kCamera);
    v4l2_queryctrl query{};
    query.id = V4L2_CTRL_FLAG_NEXT_CTRL;
    while (::ioctl(device.get(), VIDIOC_QUERYCTRL, &query) == 0) {
      for (int i = query.minimum; control == reinterpret_cast<const char*>(query.name) && i <= query.maximum;
           ++i) {
        v4l2_querymenu menu{};
        menu.id = query.id;
        menu.index = static_cast<std::uint32_t>(i);
        if (::ioctl(device.get(), VIDIOC_QUERYMENU, &menu) != 0) continue;
        if (entry != reinterpret_cast<const char*>(menu.name)) continue;
        v4l2_control set{query.id, i};
        ASSERT_EQ(::ioctl(device.get(), VIDIOC_S_CTRL, &set), 0);
        return;
      }
      query.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    }
    FAIL() << "no '" << entry << "' in '" << control << "'";
  }
  static SourceOptions camera(const std::string& fourcc = "") {
    SourceOptions options;
    options.url = std::string("v4l2:") + kCamera;
    options.pixel_format = fourcc;
    options.width_px = 320;
    options.height_px = 180;
    options.frame_timeout = 20s;
    return options;
  }
  static void bind(bool on) {
    std::ofstream(on ? "/sys/bus/platform/drivers/vivid/bind" : "/sys/bus/platform/drivers/vivid/unbind")
        << "vivid.0";
  }
};

double mean_of(const Exposure& exposure) {
  double sum = 0;
  for (const auto value : exposure.pixels.pixels) sum += value;
  return sum / static_cast<double>(exposure.pixels.pixels.size());
}

TEST_F(Vivid, EveryFormatShowsBlackWhiteAndGreenAsSuch) {
  choose("OSD Text Mode", "None");
  const V4l2Device device(kCamera);
  const auto offered = device.list_formats();
  int tested = 0;
  for (const RawFormat& format : raw_formats()) {
    const auto is_this = [&](const std::string& text) { return text.starts_with(format.fourcc); };
    if (std::ranges::none_of(offered, is_this)) continue;
    const auto source = open_source(camera(std::string(format.fourcc)));
    const double full = std::ldexp(1.0, format.bits) - 1;
    const auto shows = [&](const char* pattern) {
      choose("Test Pattern", pattern);
      const auto bracket = source->next({});
      EXPECT_EQ(bracket->exposures.at(0).pixels.width_px, 320);
      return mean_of(bracket->exposures.at(0)) / full;
    };
    const double black = shows("100% Black"), white = shows("100% White"), green = shows("100% Green"),
                 red = shows("100% Red");
    std::printf("%.3s: black %.3f white %.3f green %.3f red %.3f\n", format.fourcc.data(), black, white,
                green, red);
    EXPECT_LT(black, 0.03) << format.fourcc;
    EXPECT_GT(white, 0.9) << format.fourcc;
    const bool luma_only = !format.bayer && format.kind != RawKind::yuyv && format.kind != RawKind::uyvy &&
                           format.kind != RawKind::nv12;
    EXPECT_GT(green, luma_only ? 0.5 : 0.9) << format.fourcc;
    EXPECT_LT(red, luma_only ? 0.35 : 0.04) << format.fourcc;
    ++tested;
  }
  std::printf("%d formats tested\n", tested);
  EXPECT_GE(tested, 12);
}

TEST_F(Vivid, ControlsAreListedLockedAndReadBack) {
  set(kCamera, "Gain, Automatic", 1);
  set(kCamera, "Gain", 77);
  SourceOptions options = camera("GREY");
  options.gain_step = 12;
  const auto source = open_source(options);
  const SourceInfo info = source->describe({});
  EXPECT_TRUE(info.driver.starts_with("vivid")) << info.driver;
  EXPECT_TRUE(std::ranges::any_of(info.controls, [](const auto& text) {
    return text.starts_with("Gain 0..255") && text.ends_with("now 12");
  }));
  EXPECT_TRUE(std::ranges::any_of(info.controls, [](const auto& text) {
    return text.starts_with("Gain, Automatic") && text.ends_with("now 0");
  }));
  // vivid has no exposure control: that is said, and flagged in every frame.
  EXPECT_EQ(info.locked, std::optional(false));
  const auto bracket = source->next({});
  EXPECT_TRUE(bracket->quality.has(Quality::camera_not_locked));
  EXPECT_FALSE(bracket->exposures.at(0).exposure_s);
  EXPECT_EQ(bracket->exposures.at(0).gain_db, std::optional(0.0));
}

TEST_F(Vivid, NoSuchDeviceNoSuchFormatBusyDevice) {
  const auto fault_of = [](const SourceOptions& options) {
    try {
      open_source(options)->next({});
    } catch (const SourceError& error) {
      return error.fault();
    }
    return Fault::none;
  };
  SourceOptions options = camera();
  options.url = "v4l2:/dev/video99";
  EXPECT_EQ(fault_of(options), Fault::device_missing);
  EXPECT_EQ(fault_of(camera("XYZW")), Fault::format_unsupported);
  V4l2Device other(kCamera);
  other.choose_format("GREY", 320, 180);
  other.start();
  EXPECT_EQ(fault_of(camera("GREY")), Fault::device_busy);
  options.url = "v4l2:/dev/null";
  EXPECT_EQ(fault_of(options), Fault::device_error);
}

TEST_F(Vivid, UstreamerServesItAsMjpegAndAsSnapshot) {
  const std::string ustreamer = find_program("ustreamer");
  if (ustreamer.empty()) GTEST_SKIP() << "ustreamer is not installed";
  choose("OSD Text Mode", "None");
  choose("Test Pattern", "100% Green");
  const TempFolder folder;
  const int port = free_port();
  const Program server({ustreamer, "--device", kCamera, "--format", "YUYV", "--resolution", "320x180",
                        "--host", "127.0.0.1", "--port", std::to_string(port)},
                       folder / "log");
  wait_for_port(port);
  for (const char* address : {"mjpeg+http://127.0.0.1:{}/stream", "http://127.0.0.1:{}/snapshot"}) {
    SourceOptions options;
    options.url = fmt::format(fmt::runtime(address), port);
    // Until its encoder runs it shows a black placeholder of 640x480.
    Bracket bracket;
    const bool green = eventually(20s, [&] {
      try {
        bracket = open_source(options)->next({}).value();
      } catch (const SourceError&) {
        return false;
      }
      return mean_of(bracket.exposures.at(0)) > 200;
    });
    EXPECT_TRUE(green) << address;
    EXPECT_EQ(bracket.exposures.at(0).pixels.width_px, 320) << address;
    EXPECT_FALSE(bracket.exposures.at(0).monochrome);
  }
}

TEST_F(Vivid, UnpluggedAndBack) {
  std::mutex mutex;
  std::vector<CameraEvent> events;
  int good = 0;
  SystemClock clock;
  CameraLoopOptions options;
  options.id = "usb";
  options.schedule.interval = 1s;
  options.checks.frozen_after = 0;
  SourceOptions source = camera("GREY");
  source.stay_connected = true;
  CameraLoop loop(options, open_source(source), clock,
                  {[&](const SlotReport& report) {
                     const std::scoped_lock lock(mutex);
                     good += report.fault == Fault::none;
                   },
                   [&](const CameraEvent& event) {
                     const std::scoped_lock lock(mutex);
                     events.push_back(event);
                   }});
  const auto goods = [&] {
    const std::scoped_lock lock(mutex);
    return good;
  };
  const auto last = [&] {
    const std::scoped_lock lock(mutex);
    const auto real = std::ranges::find_if(
        events.rbegin(), events.rend(), [](const auto& event) { return event.fault != Fault::not_locked; });
    return real == events.rend() ? std::nullopt : std::optional(real->fault);
  };
  choose("Test Pattern", "75% Colorbar");
  loop.start();
  ASSERT_TRUE(eventually(20s, [&] { return goods() >= 2; }));
  bind(false);
  EXPECT_TRUE(
      eventually(10s, [&] { return last() == Fault::device_unplugged || last() == Fault::device_missing; }));
  EXPECT_TRUE(eventually(10s, [&] { return last() == Fault::device_missing; }));
  bind(true);
  const auto back = std::chrono::steady_clock::now();
  EXPECT_TRUE(eventually(20s, [&] { return last() == Fault::none; }));
  std::printf("back %.1f s after the device\n",
              std::chrono::duration<double>(std::chrono::steady_clock::now() - back).count());
}

}  // namespace
}  // namespace lampglow::testing
