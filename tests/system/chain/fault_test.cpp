// Every fault of a camera by the running program: its reason in the log, in the database and in the metrics,
// and a picture again soon after it was mended.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <functional>
#include <thread>

#include "storage/reader.h"
#include "tests/support/temporary_folder.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/chain/chain.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;

TimePoint now() {
  return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
}

// lighttpd as camera behind a bad network; it takes a new picture many times a second.
class FaultsOfAStation : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
    make_night(folder_.path(), 1);
    server_ = std::make_unique<Lighttpd>(folder_ / "camera");
    network_ = std::make_unique<BadNetwork>(server_->port());
    const auto picture = [this](int number) {
      const std::string bytes = test::read_all(folder_ / fmt::format("jpeg/images/{:04}.jpg", number));
      return std::vector<std::uint8_t>(bytes.begin(), bytes.end());
    };
    painter_ =
        std::jthread([this, pictures = std::array{picture(0), picture(1), picture(2)}](std::stop_token stop) {
          for (std::size_t i = 0; !stop.stop_requested(); ++i) {
            if (painting_) save_picture(shown(), pictures[i % 3]);
            std::this_thread::sleep_for(230ms);  // the camera's frame rate: no multiple of it is a slot
          }
        });
    station_ = std::make_unique<ChainStation>(
        folder_ / "station", folder_ / "jpeg",
        fmt::format("url = \"http://127.0.0.1:{}/open/now.jpg\"\nconnect_timeout_s = 0.5\n"
                    "stall_timeout_s = 1.5\nframe_timeout_s = 4",  // a byte per second is slow, no stall
                    network_->port()));
    ASSERT_TRUE(eventually(20s, [&] { return metric("none") > 0; })) << station_->log();
  }
  fs::path shown() const { return folder_ / "camera/www/open/now.jpg"; }

  // The program's own count of tries with this outcome.
  long metric(const std::string& reason) const {
    const std::string sample =
        fmt::format("lampglow_camera_tries_total{{camera=\"chain\",reason=\"{}\"}} ", reason);
    const std::string text = ask(station_->port(), "/metrics").body;
    const std::size_t at = text.find(sample);
    return at == std::string::npos ? 0 : std::stol(text.substr(at + sample.size()));
  }
  bool stored(const std::string& reason) const {
    return std::ranges::any_of(station_->stored(), [&](const auto& row) {
      return row.reason.starts_with(reason + ":") && !row.observation.extinction_per_m;
    });
  }
  // Of the first recovery that was stored since then.
  std::optional<TimePoint> recovered(TimePoint since) const {
    for (const auto& event : storage::Reader(station_->database()).last_events(100))
      if (event.kind == storage::EventKind::source_recovered && event.time_utc >= since)
        return event.time_utc;
    return std::nullopt;
  }

  void expect_fault(const std::string& reason, const std::function<void()>& break_it,
                    const std::function<void()>& heal) {
    break_it();
    EXPECT_TRUE(eventually(8s, [&] { return metric(reason) > 0; })) << reason << " is not in the metrics";
    EXPECT_NE(station_->log().find("warning " + reason + ":"), std::string::npos) << "not in the log\n"
                                                                                  << station_->log();
    EXPECT_TRUE(eventually(8s, [&] { return stored(reason); })) << reason << " is not in the database";
    heal();
    const TimePoint healed = now();
    ASSERT_TRUE(eventually(15s, [&] { return recovered(healed).has_value(); }))
        << "not recovered from " << reason;
    const double took_s = std::chrono::duration<double>(*recovered(healed) - healed).count();
    std::printf("%s: recovered %.1f s after it was mended\n", reason.c_str(), took_s);
    // Tries are 1 s apart, after five of them 5 s, by 20 % more or less; and there is the time of a slot.
    EXPECT_LT(took_s, 7.5) << reason;
  }

  TempFolder folder_;
  std::unique_ptr<Lighttpd> server_;
  std::unique_ptr<BadNetwork> network_;
  std::atomic<bool> painting_{true};
  std::jthread painter_;
  std::unique_ptr<ChainStation> station_;
};

TEST_F(FaultsOfAStation, OfTheNetworkAndTheServer) {
  const auto heal = [this] { network_->heal(); };
  const auto with = [this](BadNetwork::Toxics toxics) { return [this, toxics] { network_->set(toxics); }; };
  expect_fault("connection_lost", with({.cut_after_bytes = 2000}), heal);
  expect_fault("stalled", with({.stall_after_bytes = 2000}), heal);
  expect_fault("too_slow", with({.bytes_per_s = 1}), heal);  // one byte per second
  expect_fault("torn", with({.corrupt_every_bytes = 97}), heal);
}

TEST_F(FaultsOfAStation, OfThePicture) {
  const auto hold = [this](const std::vector<std::uint8_t>& bytes) {
    return [this, bytes] {
      painting_ = false;
      std::this_thread::sleep_for(500ms);  // the painter has seen it
      save_picture(shown(), bytes);
    };
  };
  const auto paint = [this] { painting_ = true; };
  auto half_grey = night(1, 760, 504);
  std::fill(half_grey.pixels.begin() + 760 * 252, half_grey.pixels.end(), std::uint16_t{128});
  expect_fault("black", hold(jpeg_of(Image<std::uint16_t>(760, 504, 3))), paint);
  expect_fault("grey", hold(jpeg_of(half_grey)), paint);
  expect_fault("frozen", hold(jpeg_of(night(99, 760, 504))), paint);
  // Told as resolution_changed first; from the next try on the new size is just not that of the site file.
  expect_fault("wrong_size", hold(jpeg_of(night(1, 160, 120))), paint);
  EXPECT_GT(metric("resolution_changed"), 0);
  EXPECT_NE(station_->log().find("warning resolution_changed:"), std::string::npos) << station_->log();
  expect_fault("not_an_image", hold({'<', 'h', 't', 'm', 'l', '>'}), paint);
  expect_fault(
      "too_large",
      [&] {
        hold({'x'})();
        fs::resize_file(shown(), 500u << 20);
      },
      paint);
}

}  // namespace
}  // namespace lampglow::testing
