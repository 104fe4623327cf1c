// A simulated night through v4l2loopback into the station's database. Only within run_vm's virtual machine.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cstdlib>
#include <mutex>

#include "daemon/config/descriptor.h"
#include "daemon/sources/image_file.h"
#include "daemon/sources/open_source.h"
#include "tests/system/chain/chain.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;

constexpr const char* kLoopback = "/dev/video10";

// Writes one picture after the other into the loopback, ten a second, until another is set.
class Projector {
 public:
  Projector(std::uint32_t fourcc, int width_px, int height_px) : fd_(::open(kLoopback, O_RDWR | O_CLOEXEC)) {
    v4l2_format format{};
    format.type = V4L2_BUF_TYPE_VIDEO_OUTPUT;
    format.fmt.pix.width = static_cast<std::uint32_t>(width_px);
    format.fmt.pix.height = static_cast<std::uint32_t>(height_px);
    format.fmt.pix.pixelformat = fourcc;
    format.fmt.pix.field = V4L2_FIELD_NONE;
    const int bytes = fourcc == V4L2_PIX_FMT_GREY ? 1 : 2;
    format.fmt.pix.bytesperline = format.fmt.pix.width * static_cast<std::uint32_t>(bytes);
    format.fmt.pix.sizeimage = format.fmt.pix.bytesperline * format.fmt.pix.height;
    EXPECT_EQ(::ioctl(fd_.get(), VIDIOC_S_FMT, &format), 0);
    EXPECT_EQ(format.fmt.pix.pixelformat, fourcc);
    wide_ = bytes == 2;
  }
  ~Projector() {
    thread_.request_stop();
    if (thread_.joinable()) thread_.join();
  }
  Projector(const Projector&) = delete;
  Projector& operator=(const Projector&) = delete;

  void show(const Image<std::uint16_t>& picture) {
    {
      const std::scoped_lock lock(mutex_);
      bytes_.clear();
      for (const std::uint16_t dn : picture.pixels) {
        bytes_.push_back(static_cast<std::uint8_t>(dn));
        if (wide_) bytes_.push_back(static_cast<std::uint8_t>(dn >> 8));
      }
    }
    if (thread_.joinable()) return;
    write_once();  // only then does the loopback offer a format to its readers
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }

 private:
  void write_once() {
    const std::scoped_lock lock(mutex_);
    EXPECT_EQ(::write(fd_.get(), bytes_.data(), bytes_.size()), static_cast<ssize_t>(bytes_.size()));
  }
  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      write_once();
      std::this_thread::sleep_for(100ms);  // the frame rate
    }
  }
  const daemon::Descriptor fd_;
  bool wide_ = false;
  std::mutex mutex_;
  std::vector<std::uint8_t> bytes_;
  std::jthread thread_;
};

class Loopback : public ::testing::Test {
 protected:
  void SetUp() override {
    if (std::getenv("LAMPGLOW_IN_VM") == nullptr) GTEST_SKIP() << "only within run_vm's virtual machine";
    ASSERT_TRUE(fs::exists(kLoopback)) << "v4l2loopback is not there";
  }
};

TEST_F(Loopback, SixteenBitsArriveBitForBit) {
  const auto picture = night(3, 320, 240, 16);
  Projector projector(V4L2_PIX_FMT_Y16, 320, 240);
  projector.show(picture);
  daemon::SourceOptions options;
  options.url = std::string("v4l2:") + kLoopback;
  const auto bracket = daemon::open_source(options)->next({});
  ASSERT_TRUE(bracket);
  EXPECT_EQ(bracket->exposures.at(0).pixels.pixels, picture.pixels);
}

TEST_F(Loopback, NightThroughTheStationBitForBit) {
  const TempFolder folder;
  const Night night = replay_night(fs::path(LAMPGLOW_VM_NIGHT) / "png", folder / "replay.db");
  ASSERT_EQ(night.truth.size(), night.pictures.size());
  Projector projector(V4L2_PIX_FMT_GREY, 760, 504);
  projector.show(daemon::load_plain_image(night.pictures[0]).pixels);
  const ChainStation station(folder / "station", night.archive,
                             std::string("url = \"v4l2:") + kLoopback + "\"\npixel_format = \"GREY\"", 5);
  for (std::size_t i = 0; i < night.pictures.size(); ++i) {
    projector.show(daemon::load_plain_image(night.pictures[i]).pixels);
    ASSERT_TRUE(station.stores(night.truth[i].observation, 90s));
  }
  // A loopback has no exposure control: said of every picture.
  for (const auto& row : station.stored()) {
    if (!row.observation.extinction_per_m) continue;
    EXPECT_TRUE(row.observation.quality.has(Quality::camera_not_locked)) << row.reason;
  }
}

}  // namespace
}  // namespace lampglow::testing
