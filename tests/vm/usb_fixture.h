// What the tests of webcams share: the camera is plugged in, watched by the camera loop, pulled out. Only
// within run_vm's machine.
#pragma once

#include <gtest/gtest.h>

#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "daemon/schedule/camera_loop.h"
#include "tests/system/cameras/support.h"
#include "tests/vm/usb_camera.h"

namespace lampglow::testing {

// The capture node of uvcvideo; empty if there is none.
std::string uvc_device();

// Of the pixels, and of the lamp's core in them.
double median_dn(const Exposure& exposure);
double core_dn(const Exposure& exposure);

class Uvc : public ::testing::Test {
 protected:
  void SetUp() override;
  void plug(UsbCameraOptions options = {});
  static daemon::SourceOptions source(std::vector<daemon::ExposureSetting> bracket = {});
  std::unique_ptr<UsbCamera> camera_;
};

// The camera loop's thread, and what it told.
class Watched {
 public:
  Watched(daemon::SourceOptions source, std::optional<daemon::AdaptOptions> adapt,
          std::chrono::seconds interval);
  int good() const { return locked(good_); }
  daemon::Fault fault() const { return locked(fault_); }
  Bracket last() const { return locked(last_); }

 private:
  template <typename T>
  T locked(const T& value) const {
    const std::scoped_lock lock(mutex_);
    return value;
  }
  daemon::SystemClock clock_;
  mutable std::mutex mutex_;
  int good_ = 0;
  daemon::Fault fault_ = daemon::Fault::none;
  Bracket last_;
  std::unique_ptr<daemon::CameraLoop> loop_;
};

}  // namespace lampglow::testing
