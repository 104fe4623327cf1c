// Two hours of virtual time with a fault every minute: nothing leaks, and every slot has a record.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <condition_variable>
#include <cstdlib>
#include <map>
#include <mutex>

#include "daemon/schedule/camera_loop.h"
#include "tests/system/cameras/web_servers.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;

// Time that runs faster than the machine's.
class FastClock : public Clock {
 public:
  explicit FastClock(int speed) : speed_(speed) {}
  MonotonicTime monotonic() const override {
    return start_ + speed_ * (std::chrono::steady_clock::now() - start_);
  }
  TimePoint utc() const override {
    return start_utc_ + std::chrono::floor<std::chrono::milliseconds>(monotonic() - start_);
  }
  bool synchronised() const override { return true; }
  bool wait_until(MonotonicTime time, std::stop_token stop) override {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    std::condition_variable_any wake;
    const auto left = time - monotonic();
    if (left > 0s) wake.wait_for(lock, stop, left / speed_ + 1us, [] { return false; });
    return !stop.stop_requested();
  }

 private:
  const int speed_;
  const MonotonicTime start_ = std::chrono::steady_clock::now();
  const TimePoint start_utc_ = parse_time_utc("2026-11-22T18:00:00Z").value();
};

struct Tally {
  std::mutex mutex;
  std::vector<TimePoint> slots;
  std::map<Fault, int> by_fault;
  int without_reason = 0;

  void take(const SlotReport& report) {
    const std::scoped_lock lock(mutex);
    slots.push_back(report.slot_utc);
    ++by_fault[report.fault];
    without_reason +=
        report.fault == Fault::none ? report.bracket.exposures.empty() : report.bracket.fault.empty();
  }
};

// Three cameras behind one server, each with its own bad network.
TEST(CameraSoak, TwoHoursWithAFaultEveryMinute) {
  if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
  const char* asked = std::getenv("LAMPGLOW_SOAK_SPEED");
  const int speed = asked != nullptr ? std::atoi(asked) : 240;  // two hours in 30 s
  const auto real_time = std::chrono::milliseconds(7'200'000 / speed);
  TempFolder folder;
  Lighttpd server(folder.path());
  std::jthread painter([&](std::stop_token stop) {
    for (int number = 0; !stop.stop_requested(); ++number) {
      save_picture(folder / "www/open/snapshot.jpg", jpeg_of(night(number % 50, 160, 120)));
      std::this_thread::sleep_for(10ms);
    }
  });
  eventually(2s, [&] { return fs::exists(folder / "www/open/snapshot.jpg"); });

  FastClock clock(speed);
  std::array<Tally, 3> tallies;
  std::vector<std::unique_ptr<BadNetwork>> networks;
  std::vector<std::unique_ptr<CameraLoop>> loops;
  for (std::size_t i = 0; i < tallies.size(); ++i) {
    networks.push_back(std::make_unique<BadNetwork>(server.port()));
    SourceOptions source;
    source.url = fmt::format("http://127.0.0.1:{}/open/snapshot.jpg", networks[i]->port());
    source.connect_timeout = source.stall_timeout = 50ms;
    source.frame_timeout = 200ms;
    CameraLoopOptions options;
    options.id = fmt::format("camera{}", i);
    options.schedule.interval = 60s;
    options.clock_step = std::chrono::milliseconds(60'000);  // the fast clock's jitter is no step
    options.checks.frozen_after = 0;
    options.seed = i;
    loops.push_back(std::make_unique<CameraLoop>(
        options, open_source(source), clock,
        CameraCallbacks{[&tally = tallies[i]](const SlotReport& report) { tally.take(report); }, {}}));
  }
  for (auto& loop : loops) loop->start();

  const auto began = std::chrono::steady_clock::now();
  const auto ran = [&] { return std::chrono::steady_clock::now() - began; };
  long early_kib = 0;
  int early_descriptors = 0, minute = 0;
  while (ran() < real_time) {
    const BadNetwork::Toxics toxics[] = {{.cut_after_bytes = 1'000},  {.stall_after_bytes = 500},
                                         {.corrupt_every_bytes = 50}, {.bytes_per_s = 20},
                                         {.cut_after_bytes = 0},      {.delay_ms = 300}};
    for (std::size_t i = 0; i < networks.size(); ++i) {
      networks[i]->set(toxics[static_cast<std::size_t>(minute + static_cast<int>(i)) % std::size(toxics)]);
    }
    std::this_thread::sleep_for(30'000ms / speed);
    // Two minutes of four are faulty to their end: longer than a slot, which then has no picture.
    for (auto& network : networks) {
      if (minute % 4 >= 2) network->heal();
    }
    std::this_thread::sleep_for(30'000ms / speed);
    ++minute;
    if (early_kib == 0 && ran() > real_time / 4) {
      early_kib = resident_kib();
      early_descriptors = open_descriptors();
    }
  }
  const long late_kib = resident_kib();
  for (auto& loop : loops) loop->request_stop();
  for (auto& loop : loops) loop->join();
  for (auto& loop : loops) {
    const CameraStatus status = loop->status();
    std::uint64_t faulty = 0;
    for (const auto& [fault, count] : status.tries) faulty += fault == Fault::none ? 0 : count;
    std::printf("%s: %lu faulty tries\n", status.camera.c_str(), static_cast<unsigned long>(faulty));
    EXPECT_GT(faulty, 100u);
  }
  loops.clear();
  std::this_thread::sleep_for(200ms);
  std::printf("RSS %ld kiB after a quarter, %ld kiB at the end; %d descriptors, then %d\n", early_kib,
              late_kib, early_descriptors, open_descriptors());
#if !defined(__SANITIZE_THREAD__) && !defined(__SANITIZE_ADDRESS__)
  EXPECT_LT(late_kib, early_kib * 1.05);
#endif
  EXPECT_LE(open_descriptors(), early_descriptors);
  for (Tally& tally : tallies) {
    EXPECT_EQ(tally.without_reason, 0);
    EXPECT_GT(tally.slots.size(), 100u);
    EXPECT_GT(tally.by_fault[Fault::none], 30);
    EXPECT_GT(tally.by_fault.size(), 1u) << "no fault was seen";
    for (std::size_t i = 1; i < tally.slots.size(); ++i) {
      EXPECT_EQ(tally.slots[i] - tally.slots[i - 1], 60s) << "slot " << i << " of " << tally.slots.size();
    }
    for (const auto& [fault, count] : tally.by_fault) std::printf("%s %d, ", to_string(fault).data(), count);
    std::printf("of %zu slots\n", tally.slots.size());
  }
}

}  // namespace
}  // namespace lampglow::testing
