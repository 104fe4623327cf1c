// The camera loop against a real server: every slot has a record, every fault its reason and its recovery.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <ctime>
#include <mutex>

#include "daemon/schedule/camera_loop.h"
#include "tests/system/cameras/web_servers.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

// What a loop tells, collected.
class Log {
 public:
  CameraCallbacks callbacks() {
    return {[this](SlotReport report) {
              const std::scoped_lock lock(mutex_);
              slots_.push_back(std::move(report));
            },
            [this](CameraEvent event) {
              const std::scoped_lock lock(mutex_);
              events_.push_back(std::move(event));
            }};
  }
  std::vector<SlotReport> slots() const {
    const std::scoped_lock lock(mutex_);
    return slots_;
  }
  std::vector<CameraEvent> events() const {
    const std::scoped_lock lock(mutex_);
    return events_;
  }
  int good() const { return static_cast<int>(std::ranges::count(slots(), Fault::none, &SlotReport::fault)); }
  bool saw(Fault fault) const {
    const auto all = events();
    return std::ranges::find(all, fault, &CameraEvent::fault) != all.end();
  }
  std::optional<CameraEvent> last_event() const {
    const auto all = events();
    return all.empty() ? std::nullopt : std::optional(all.back());
  }

 private:
  mutable std::mutex mutex_;
  std::vector<SlotReport> slots_;
  std::vector<CameraEvent> events_;
};

// UTC can be set; everything else is the machine's.
class SettableClock : public SystemClock {
 public:
  TimePoint utc() const override { return SystemClock::utc() + std::chrono::milliseconds(offset_ms_.load()); }
  bool synchronised() const override { return synchronised_; }
  void step(std::chrono::milliseconds by) { offset_ms_ += by.count(); }
  void lose_ntp() { synchronised_ = false; }

 private:
  std::atomic<std::int64_t> offset_ms_{0};
  std::atomic<bool> synchronised_{true};
};

class CameraLoopTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
    server_ = std::make_unique<Lighttpd>(folder_.path());
    network_ = std::make_unique<BadNetwork>(server_->port());
    painter_ = std::jthread([this](std::stop_token stop) {  // the camera behind the server takes new pictures
      for (int number = 0; !stop.stop_requested(); ++number) {
        if (painting_) show(jpeg_of(night(number)));
        std::this_thread::sleep_for(40ms);
      }
    });
    eventually(2s, [this] { return fs::exists(picture()); });
  }
  void TearDown() override {
    painter_.request_stop();
    if (painter_.joinable()) painter_.join();
  }
  fs::path picture() const { return folder_ / "www/open/snapshot.jpg"; }
  void show(const std::vector<std::uint8_t>& bytes) { save_picture(picture(), bytes); }
  void hold(const std::vector<std::uint8_t>& bytes) {
    painting_ = false;
    std::this_thread::sleep_for(80ms);
    show(bytes);
  }

  std::unique_ptr<CameraLoop> loop(Log& log, CameraLoopOptions options = {}) {
    SourceOptions source;
    source.url = fmt::format("http://127.0.0.1:{}/open/snapshot.jpg", network_->port());
    source.connect_timeout = 500ms;
    source.stall_timeout = 300ms;
    source.frame_timeout = 1s;
    options.id = "porch";
    options.schedule.interval = 1s;
    options.checks = {.width_px = 320, .height_px = 240, .bit_depth = 8, .frozen_after = 3};
    return std::make_unique<CameraLoop>(options, open_source(source), clock_, log.callbacks());
  }

  // Brings the fault about, heals it, and asks for reason and recovery in time.
  void expect_fault(Log& log, Fault fault, const std::function<void()>& break_it,
                    const std::function<void()>& heal) {
    break_it();
    EXPECT_TRUE(eventually(6s, [&] { return log.last_event() && log.last_event()->fault == fault; }))
        << to_string(fault) << " did not show";
    heal();
    // The ladder's first rungs are 1 s: with jitter and one slot the camera is back within 3 s.
    EXPECT_TRUE(eventually(3s, [&] { return log.last_event()->fault == Fault::none; }))
        << "not recovered from " << to_string(fault);
  }

  TempFolder folder_;
  SettableClock clock_;
  std::unique_ptr<Lighttpd> server_;
  std::unique_ptr<BadNetwork> network_;
  std::atomic<bool> painting_{true};
  std::jthread painter_;
};

TEST_F(CameraLoopTest, OneReportForEverySlotAndNoneTwice) {
  Log log;
  const auto camera = loop(log);
  camera->start();
  EXPECT_TRUE(eventually(6s, [&] { return log.good() >= 3; }));
  camera->request_stop();
  camera->join();
  const auto slots = log.slots();
  for (std::size_t i = 0; i < slots.size(); ++i) {
    EXPECT_EQ(slots[i].fault, Fault::none) << slots[i].bracket.fault;
    EXPECT_EQ(slots[i].slot_utc.time_since_epoch().count() % 1000, 0);
    if (i > 0) {
      EXPECT_EQ(slots[i].slot_utc - slots[i - 1].slot_utc, 1s);
    }
    EXPECT_EQ(slots[i].bracket.exposures.size(), 1u);
    EXPECT_LT(slots[i].bracket.time_utc - slots[i].slot_utc, 300ms);
  }
  EXPECT_TRUE(camera->status().up);
  EXPECT_TRUE(log.events().empty());
}

TEST_F(CameraLoopTest, NetworkFaultsOneAfterTheOther) {
  Log log;
  const auto camera = loop(log);
  camera->start();
  ASSERT_TRUE(eventually(3s, [&] { return log.good() >= 1; }));
  const auto heal = [this] { network_->heal(); };
  expect_fault(
      log, Fault::connection_lost, [this] { network_->set({.cut_after_bytes = 2000}); }, heal);
  expect_fault(
      log, Fault::stalled, [this] { network_->set({.stall_after_bytes = 2000}); }, heal);
  expect_fault(
      log, Fault::too_slow, [this] { network_->set({.bytes_per_s = 10}); }, heal);
  expect_fault(
      log, Fault::torn, [this] { network_->set({.corrupt_every_bytes = 97}); }, heal);
  camera->request_stop();
  camera->join();
  // Every slot from the first to the last has a record.
  const auto slots = log.slots();
  for (std::size_t i = 1; i < slots.size(); ++i)
    EXPECT_EQ(slots[i].slot_utc - slots[i - 1].slot_utc, 1s) << i;
  for (const SlotReport& slot : slots) {
    EXPECT_EQ(slot.fault == Fault::none, !slot.bracket.exposures.empty());
    EXPECT_EQ(slot.fault == Fault::none, slot.bracket.fault.empty());
    if (slot.fault != Fault::none) {
      EXPECT_FALSE(slot.bracket.quality.empty());
    }
  }
}

TEST_F(CameraLoopTest, PicturesThatCantBeTrueOneAfterTheOther) {
  Log log;
  const auto camera = loop(log);
  camera->start();
  ASSERT_TRUE(eventually(3s, [&] { return log.good() >= 1; }));
  const auto paint = [this] { painting_ = true; };
  const auto half_grey = [] {
    auto picture = night(1);
    std::fill(picture.pixels.begin() + std::ptrdiff_t{320} * 120, picture.pixels.end(), std::uint16_t{128});
    return jpeg_of(picture);
  };
  expect_fault(
      log, Fault::black, [this] { hold(jpeg_of(Image<std::uint16_t>(320, 240, 3))); }, paint);
  expect_fault(
      log, Fault::grey, [&] { hold(half_grey()); }, paint);
  expect_fault(
      log, Fault::frozen, [this] { hold(jpeg_of(night(99))); }, paint);
  expect_fault(
      log, Fault::wrong_size, [this] { hold(jpeg_of(night(1, 160, 120))); }, paint);
  EXPECT_TRUE(log.saw(Fault::resolution_changed));
  auto torn = jpeg_of(night(3));
  torn.resize(torn.size() / 2);
  expect_fault(
      log, Fault::torn, [&] { hold(torn); }, paint);
}

TEST_F(CameraLoopTest, ClockStepIsToldAndUnsynchronisedIsFlagged) {
  Log log;
  const auto camera = loop(log);
  camera->start();
  ASSERT_TRUE(eventually(3s, [&] { return log.good() >= 1; }));
  for (const auto step : {std::chrono::milliseconds(-3'600'000), std::chrono::milliseconds(7'200'000)}) {
    const int before = log.good();
    clock_.step(step);
    EXPECT_TRUE(
        eventually(4s, [&] { return log.last_event() && log.last_event()->fault == Fault::clock_stepped; }));
    EXPECT_TRUE(eventually(4s, [&] { return log.good() >= before + 2; })) << "no pictures after the step";
  }
  EXPECT_LT(log.slots().size(), 15u) << "the hours that the clock jumped over are no slots";
  clock_.lose_ntp();
  const int before = log.good();
  EXPECT_TRUE(eventually(4s, [&] { return log.good() >= before + 2; }));
  EXPECT_TRUE(log.slots().back().bracket.quality.has(Quality::clock_unsynchronised));
  EXPECT_FALSE(log.slots().front().bracket.quality.has(Quality::clock_unsynchronised));
}

// A computer without a clock of its own: it is started in the night with the time of noon, and NTP tells
// later.
TEST_F(CameraLoopTest, AClockThatIsPutRightWhileTheNightIsWaitedForEndsTheWait) {
  Log log;
  CameraLoopOptions options;
  options.schedule.part = DayPart::night;
  options.place = Place{52.1, 5.2};
  const auto camera = loop(log, options);
  clock_.step(parse_time_utc("2026-11-22T12:00:00Z").value() - clock_.utc());
  camera->start();
  std::this_thread::sleep_for(1500ms);
  EXPECT_TRUE(log.slots().empty());
  clock_.step(8h);
  EXPECT_TRUE(eventually(15s, [&] { return log.good() >= 1; })) << "it still waits for the evening";
  EXPECT_TRUE(log.saw(Fault::clock_stepped));
}

TEST_F(CameraLoopTest, OneThatFailsNeverDelaysAnother) {
  Log good_log, bad_log;
  BadNetwork bad_network(server_->port());
  bad_network.set({.stall_after_bytes = 100});
  SourceOptions bad;
  bad.url = fmt::format("http://127.0.0.1:{}/open/snapshot.jpg", bad_network.port());
  bad.stall_timeout = bad.frame_timeout = 30s;
  CameraLoopOptions options;
  options.id = "barn";
  options.schedule.interval = 1s;
  CameraLoop stuck(options, open_source(bad), clock_, bad_log.callbacks());
  const auto camera = loop(good_log);
  stuck.start();
  camera->start();
  EXPECT_TRUE(eventually(8s, [&] { return good_log.good() >= 4; }));
  for (const SlotReport& slot : good_log.slots()) EXPECT_LT(slot.latency, 500ms);
  EXPECT_EQ(bad_log.good(), 0);
  const auto began = std::chrono::steady_clock::now();
  stuck.request_stop();
  stuck.join();
  EXPECT_LT(std::chrono::steady_clock::now() - began, 500ms);
  ASSERT_FALSE(bad_log.slots().empty());
  EXPECT_EQ(bad_log.slots().back().fault, Fault::stopped);
}

TEST_F(CameraLoopTest, IdleBetweenPicturesCostsNothing) {
  Log log;
  CameraLoopOptions options;
  const auto camera = loop(log, options);
  painting_ = false;
  std::this_thread::sleep_for(100ms);
  TearDown();
  SourceOptions source;
  source.url = fmt::format("http://127.0.0.1:{}/open/snapshot.jpg", network_->port());
  options.schedule.interval = 3600s;
  CameraLoop idle(options, open_source(source), clock_, log.callbacks());
  network_.reset();  // its acceptor polls; the loop must not
  idle.start();
  std::this_thread::sleep_for(100ms);
  const std::clock_t before = std::clock();
  std::this_thread::sleep_for(2s);
  const double cpu_s = static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC;
  EXPECT_LT(cpu_s, 0.005);
}

}  // namespace
}  // namespace lampglow::testing
