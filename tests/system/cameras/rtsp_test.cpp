// RTSP from gst-rtsp-server: H.264 and H.265, a stream that dies and returns.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "daemon/sources/fault.h"
#include "daemon/sources/open_source.h"
#include "tests/system/cameras/stream_servers.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kFrames = 10;
const std::string kRtspPassword = "p:a ss@w/r#d%41&";

struct Tried {
  Fault fault = Fault::none;
  std::string message;
  std::optional<Bracket> bracket;
  std::chrono::duration<double> took{};
};

Tried try_once(FrameSource& source, std::stop_token stop = {}) {
  const auto began = std::chrono::steady_clock::now();
  Tried tried;
  try {
    tried.bracket = source.next(stop);
  } catch (const SourceError& error) {
    tried.fault = error.fault();
    tried.message = error.what();
  }
  tried.took = std::chrono::steady_clock::now() - began;
  return tried;
}

class RtspCameraTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!rtsp_available())
      GTEST_SKIP() << "gst-rtsp-server (gir1.2-gst-rtsp-server-1.0) or ffmpeg is not installed";
  }

  // Ten frames of the night, again and again for half a minute, a key frame every second.
  void record(const std::string& encoder) {
    for (int i = 0; i < kFrames; ++i) write_bytes(folder_ / fmt::format("{}.png", i), png_of(night(i), 8));
    record_movie((folder_ / "%d.png").string(), encoder, 5, 15, movie());
  }
  fs::path movie() const { return folder_ / "night.mp4"; }
  void serve(const std::string& codec, bool with_password = false) {
    using Account = std::vector<std::string>;
    server_ = std::make_unique<RtspServer>(folder_.path(), movie(), codec, port_,
                                           with_password ? Account{"admin", kRtspPassword} : Account{});
  }
  SourceOptions options(int port) const {
    SourceOptions options;
    options.url = fmt::format("rtsp://127.0.0.1:{}/camera", port);
    options.connect_timeout = 5s;
    options.stall_timeout = 2s;
    options.frame_timeout = 8s;
    return options;
  }
  // Mean and largest difference to the frame of the night that is nearest.
  static std::pair<double, int> loss(const Bracket& bracket) {
    std::pair<double, int> best{1e9, 0};
    for (int i = 0; i < kFrames; ++i) {
      const auto original = night(i).pixels;
      const auto& got = bracket.exposures.at(0).pixels.pixels;
      if (got.size() != original.size()) return best;
      double sum = 0;
      int largest = 0;
      for (std::size_t p = 0; p < got.size(); ++p) {
        const int difference = std::abs(got[p] - original[p]);
        sum += difference;
        largest = std::max(largest, difference);
      }
      best = std::min(best, std::pair(sum / static_cast<double>(got.size()), largest));
    }
    return best;
  }

  TempFolder folder_;
  int port_ = free_port();
  std::unique_ptr<RtspServer> server_;
};

TEST_F(RtspCameraTest, LosslessH264ArrivesBitForBit) {
  record("-c:v libx264 -preset ultrafast -qp 0 -g 5");
  serve("h264");
  const Tried tried = try_once(*open_source(options(port_)));
  ASSERT_TRUE(tried.bracket) << tried.message;
  EXPECT_EQ(loss(*tried.bracket), (std::pair<double, int>{0, 0}));
  EXPECT_TRUE(tried.bracket->exposures[0].monochrome);
}

TEST_F(RtspCameraTest, H265WithinTheCodecsLoss) {
  record("-c:v libx265 -preset ultrafast -crf 16 -x265-params log-level=none:keyint=5 -tag:v hvc1");
  serve("h265");
  const Tried tried = try_once(*open_source(options(port_)));
  ASSERT_TRUE(tried.bracket) << tried.message;
  const auto [mean_dn, largest_dn] = loss(*tried.bracket);
  std::printf("H.265 crf 16: mean |difference| %.2f DN, largest %d DN (noise of the frames: 2.55 DN)\n",
              mean_dn, largest_dn);
  EXPECT_LT(mean_dn, 2.5);
}

TEST_F(RtspCameraTest, StayingConnectedGivesThePresentPicture) {
  record("-c:v libx264 -preset ultrafast -qp 0 -g 5");
  serve("h264");
  SourceOptions stay = options(port_);
  stay.stay_connected = true;
  const auto source = open_source(stay);
  const Tried first = try_once(*source);
  ASSERT_TRUE(first.bracket) << first.message;
  std::this_thread::sleep_for(1500ms);
  const Tried second = try_once(*source);
  ASSERT_TRUE(second.bracket) << second.message;
  EXPECT_EQ(loss(*second.bracket).second, 0);
  EXPECT_LT(second.took.count(), 2.5);
}

TEST_F(RtspCameraTest, StreamThatDiesAndReturns) {
  record("-c:v libx264 -preset ultrafast -qp 0 -g 5");
  serve("h264");
  BadNetwork network(port_);
  SourceOptions stay = options(network.port());
  stay.stay_connected = true;
  const auto source = open_source(stay);
  Tried tried = try_once(*source);
  ASSERT_EQ(tried.fault, Fault::none) << tried.message;
  network.set({.stall_after_bytes = 0});
  tried = try_once(*source);
  EXPECT_THAT((std::vector{Fault::stalled, Fault::no_key_frame}), ::testing::Contains(tried.fault))
      << tried.message;
  EXPECT_LT(tried.took.count(), 9);
  network.set({.cut_after_bytes = 20'000});
  EXPECT_NE(try_once(*source).fault, Fault::none);
  network.heal();
  tried = try_once(*source);
  EXPECT_EQ(tried.fault, Fault::none) << tried.message;

  server_->kill();
  tried = try_once(*source);
  EXPECT_THAT((std::vector{Fault::connection_lost, Fault::stream_ended, Fault::stalled}),
              ::testing::Contains(tried.fault))
      << to_string(tried.fault) << tried.message;
  serve("h264");
  tried = try_once(*source);
  EXPECT_EQ(tried.fault, Fault::none) << tried.message;
}

TEST_F(RtspCameraTest, NobodyThereWrongPathWrongPassword) {
  EXPECT_EQ(try_once(*open_source(options(port_))).fault, Fault::connection_refused);
  record("-c:v libx264 -preset ultrafast -qp 0 -g 5");
  serve("h264", true);
  SourceOptions guarded = options(port_);
  Tried tried = try_once(*open_source(guarded));
  EXPECT_EQ(tried.fault, Fault::unauthorised) << tried.message;
  guarded.credentials_file = (folder_ / "credentials").string();
  write_file(folder_ / "credentials", "admin:wrong");
  tried = try_once(*open_source(guarded));
  EXPECT_EQ(tried.fault, Fault::unauthorised) << tried.message;
  EXPECT_THAT(tried.message, Not(HasSubstr("wrong")));
  write_file(folder_ / "credentials", "admin:" + kRtspPassword + "\n");
  tried = try_once(*open_source(guarded));
  EXPECT_EQ(tried.fault, Fault::none) << tried.message;
  guarded.url = fmt::format("rtsp://127.0.0.1:{}/nowhere", port_);
  EXPECT_EQ(try_once(*open_source(guarded)).fault, Fault::http_error);
}

TEST_F(RtspCameraTest, SilentServerAndStop) {
  record("-c:v libx264 -preset ultrafast -qp 0 -g 5");
  serve("h264");
  BadNetwork network(port_);
  network.set({.stall_after_bytes = 0});
  const auto source = open_source(options(network.port()));
  std::stop_source stop;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(300ms);
    stop.request_stop();
  });
  const Tried tried = try_once(*source, stop.get_token());
  EXPECT_FALSE(tried.bracket);
  EXPECT_EQ(tried.fault, Fault::none) << tried.message;
  EXPECT_LT(tried.took.count(), 1.5);
}

}  // namespace
}  // namespace lampglow::testing
