#include "tests/vm/usb_fixture.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>

#include "daemon/sources/fault.h"

namespace lampglow::testing {

using namespace daemon;
using namespace std::chrono_literals;

// Metadata nodes have a higher index.
std::string uvc_device() {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator("/sys/class/video4linux", ignored)) {
    std::string name, index;
    std::getline(std::ifstream(entry.path() / "index") >> std::ws, index);
    const auto driver = fs::read_symlink(entry.path() / "device/driver", ignored).filename();
    const fs::path node = fs::path("/dev") / entry.path().filename();
    if (driver == "uvcvideo" && index == "0" && fs::exists(node)) return node;
  }
  return "";
}

double median_dn(const Exposure& exposure) {
  auto pixels = exposure.pixels.pixels;
  std::ranges::nth_element(pixels, pixels.begin() + static_cast<std::ptrdiff_t>(pixels.size() / 2));
  return pixels[pixels.size() / 2];
}
double core_dn(const Exposure& exposure) {
  return exposure.pixels.at(UsbCamera::kWidthPx / 2, UsbCamera::kHeightPx / 2);
}

void Uvc::SetUp() {
  if (std::getenv("LAMPGLOW_IN_VM") == nullptr) GTEST_SKIP() << "only within run_vm's virtual machine";
}

void Uvc::plug(UsbCameraOptions options) {
  // The kernel takes a moment to see that the last one is gone.
  ASSERT_TRUE(eventually(30s, [] { return uvc_device().empty(); })) << uvc_device();
  camera_ = std::make_unique<UsbCamera>(options);
  ASSERT_TRUE(eventually(30s, [] { return !uvc_device().empty(); })) << "no /dev/video of the USB camera";
}

SourceOptions Uvc::source(std::vector<ExposureSetting> bracket) {
  SourceOptions options;
  options.url = "v4l2:" + uvc_device();
  options.frame_timeout = 60s;
  options.bracket = std::move(bracket);
  return options;
}

Watched::Watched(SourceOptions source, std::optional<AdaptOptions> adapt, std::chrono::seconds interval) {
  CameraLoopOptions options;
  options.id = "usb";
  options.schedule.interval = interval;
  options.checks = {UsbCamera::kWidthPx, UsbCamera::kHeightPx, 12, 3};
  options.adapt = adapt;
  loop_ = std::make_unique<CameraLoop>(options, open_source(source), clock_,
                                       CameraCallbacks{[this](SlotReport report) {
                                                         const std::scoped_lock lock(mutex_);
                                                         good_ += report.fault == Fault::none;
                                                         if (report.fault == Fault::none)
                                                           last_ = std::move(report.bracket);
                                                       },
                                                       [this](CameraEvent event) {
                                                         const std::scoped_lock lock(mutex_);
                                                         fault_ = event.fault;
                                                       }});
  loop_->start();
}

}  // namespace lampglow::testing
