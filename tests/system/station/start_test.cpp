// A station that is told to end while it starts: it does so in time, says so, and has harmed nothing.
#include <gmock/gmock.h>
#include <signal.h>

#include <algorithm>
#include <cstdio>
#include <thread>

#include "storage/maintenance.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/support/run_program.h"
#include "tests/system/station/notify_socket.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using test::run_program;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr auto kLimit = 5s;

// Programs that begin while it lives have a slow disk.
class SlowDisk {
 public:
  static constexpr auto kRead = 2ms;
  SlowDisk() { ::setenv("LD_PRELOAD", LAMPGLOW_SLOW_DISK, 1); }
  ~SlowDisk() { ::unsetenv("LD_PRELOAD"); }
  SlowDisk(const SlowDisk&) = delete;
  SlowDisk& operator=(const SlowDisk&) = delete;
};

class Start : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto run = run_program({"simulate", archive().string(), "--style", "webcam", "--seed", "3",
                                  "--frames", "1", "--photons", "50000"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    configure("night");
  }
  fs::path archive() const { return folder_ / "night"; }
  fs::path config_file() const { return folder_ / "station.toml"; }
  fs::path database() const { return folder_ / "data/lampglow.db"; }

  void configure(const std::string& reference) const {
    write_file(config_file(), "name = \"quay\"\nsite_file = \"night/site.toml\"\nreference_archive = \"" +
                                  reference +
                                  "\"\n[source]\nurl = \"archive:night\"\n[station]\ndata_directory = "
                                  "\"data\"\n[http]\nport = " +
                                  std::to_string(port_) + "\n");
  }

  // Clear brackets that take minutes to learn from.
  void make_long_reference() const {
    fs::copy(archive(), folder_ / "long", fs::copy_options::recursive);
    lengthen(folder_ / "long", 5000, "clear_reference");
  }

  void expect_ended_before_ready(Serving& station, int signal, const std::string& broken_off) const {
    ASSERT_THAT(station.log(), Not(HasSubstr("station started"))) << "the start is too short for this test";
    const auto asked = std::chrono::steady_clock::now();
    station.signal(signal);
    EXPECT_EQ(station.wait(kLimit), 128 + signal) << station.log();
    const std::chrono::duration<double> took = std::chrono::steady_clock::now() - asked;
    std::printf("ended %.2f s after the signal\n", took.count());
    EXPECT_THAT(station.log(),
                HasSubstr(std::string("lampglow: ended by ") + (signal == SIGTERM ? "SIGTERM" : "SIGINT") +
                          " before the station was ready; nothing was measured: "));
    EXPECT_THAT(station.log(), HasSubstr(broken_off));
  }

  // The database is whole, is the one it was, and the next start comes to its end.
  void expect_unharmed() const {
    const auto check = run_program({"db", "check", database().string()});
    EXPECT_EQ(check.exit_code, 0) << check.out << check.err;
    configure("night");
    Serving station(config_file(), folder_ / "next-log");
    EXPECT_TRUE(eventually(20s, [&] { return ask(port_, "/readyz").status == 200; })) << station.log();
    EXPECT_TRUE(eventually(10s, [&] { return ask(port_, "/v1/frames/latest.jpg").status == 200; }));
    station.signal(SIGTERM);
    EXPECT_EQ(station.wait(kLimit), 0) << station.log();
    EXPECT_THAT(station.log(), Not(HasSubstr("damaged")));
    for (const auto& entry : fs::directory_iterator(folder_ / "data"))
      EXPECT_THAT(entry.path().filename().string(), Not(HasSubstr("corrupt")));
  }

  TempFolder folder_;
  int port_ = free_port();
};

TEST_F(Start, EndsInTimeWhileItLearnsTheReference) {
  make_long_reference();
  for (const int signal : {SIGTERM, SIGINT}) {
    configure("long");
    const fs::path log = folder_ / ("log-" + std::to_string(signal));
    const NotifySocket systemd(folder_ / "notify");
    Serving station(config_file(), log);
    ASSERT_TRUE(eventually(10s, [&] { return fs::exists(database()); })) << station.log();
    EXPECT_TRUE(
        eventually(3s, [&] { return systemd.heard().find("EXTEND_TIMEOUT_USEC=") != std::string::npos; }));
    std::this_thread::sleep_for(1s);
    expect_ended_before_ready(station, signal, "learning the clear reference of camera quay was broken off");
  }
  expect_unharmed();
}

TEST_F(Start, EndsInTimeWhileItChecksALargeDatabaseOnASlowDisk) {
  constexpr int kFrames = 45000;
  {
    fs::create_directories(folder_ / "data");
    storage::Store store(database(), {.batch_frames = 5000});
    const auto camera = store.upsert_camera("of last months", testing_support::harbour());
    const TimePoint first = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now()) -
                            std::chrono::hours(60 * 24);
    for (int i = 0; i < kFrames; ++i)
      store.put(camera, testing_support::foggy(first + std::chrono::minutes(i)));
    store.checkpoint();
  }
  constexpr int kPage = 4096;
  ASSERT_GT(fs::file_size(database()) / kPage * SlowDisk::kRead, 2 * kLimit) << "the check is too short";
  {
    const SlowDisk slow;
    Serving station(config_file(), folder_ / "log");
    std::this_thread::sleep_for(2s);
    expect_ended_before_ready(station, SIGTERM, "lampglow.db: the check was broken off");
  }
  EXPECT_EQ(storage::check(database(), true), "ok");
  expect_unharmed();
  const auto rows = run_program({"export", database().string(), "--camera", "of last months"});
  EXPECT_EQ(std::count(rows.out.begin(), rows.out.end(), '\n'), kFrames + 1) << rows.err;
}

// The same learning, in a reload: what runs is ended as ever.
TEST_F(Start, EndsInTimeWhileAReloadLearnsTheReference) {
  make_long_reference();
  const NotifySocket systemd(folder_ / "notify");
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(eventually(20s, [&] { return ask(port_, "/readyz").status == 200; })) << station.log();
  configure("long");
  station.signal(SIGHUP);
  ASSERT_TRUE(eventually(3s, [&] { return systemd.heard().find("RELOADING=1") != std::string::npos; }));
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(systemd.fed_within(3s)) << "learning is progress";
  ASSERT_THAT(station.log(), Not(HasSubstr("configuration reloaded")));
  station.signal(SIGTERM);
  EXPECT_EQ(station.wait(kLimit), 0) << station.log();
  EXPECT_THAT(station.log(),
              HasSubstr("the old one stays reason=\"learning the clear reference of camera quay"));
  expect_unharmed();
}

}  // namespace
}  // namespace lampglow::testing
