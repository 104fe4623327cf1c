// The watchdog is fed by progress alone: single threads of a running station are frozen with ptrace, as a
// driver or a disk that never answers would freeze them, while all others go on.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/ptrace.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>
#include <memory>

#include "tests/support/run_program.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/station/notify_socket.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;
using test::read_all;
using test::run_program;

// A thread of a process by its name, only one that is running on a processor or waits for one if `busy`; 0 if
// there is none.
pid_t thread_of(pid_t process, const std::string& name, bool busy = false) {
  pid_t found = 0;
  for (const auto& task : fs::directory_iterator("/proc/" + std::to_string(process) + "/task")) {
    if (read_all(task.path() / "comm") != name + "\n") continue;
    if (busy && read_all(task.path() / "stat").find(") R ") == std::string::npos) continue;
    found = std::stoi(task.path().filename());
  }
  return found;
}

// Holds one thread of a child process.
class Frozen {
 public:
  explicit Frozen(pid_t thread) : thread_(thread) {
    if (thread_ == 0 || ::ptrace(PTRACE_SEIZE, thread_, nullptr, nullptr) != 0 ||
        ::ptrace(PTRACE_INTERRUPT, thread_, nullptr, nullptr) != 0 ||
        ::waitpid(thread_, nullptr, __WALL) != thread_)
      thread_ = 0;
  }
  ~Frozen() {
    if (thread_) ::ptrace(PTRACE_DETACH, thread_, nullptr, nullptr);
  }
  Frozen(const Frozen&) = delete;
  Frozen& operator=(const Frozen&) = delete;
  bool held() const { return thread_ != 0; }

 private:
  pid_t thread_ = 0;
};

TEST(Watchdog, IsFedByTheProgressOfScheduleAndWriterAlone) {
  if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
  const TempFolder folder;
  const fs::path archive = folder / "night", picture = folder / "camera/www/open/now.jpg";
  ASSERT_EQ(
      run_program({"simulate", archive.string(), "--style", "webcam", "--frames", "1", "--photons", "50000"})
          .exit_code,
      0);
  Lighttpd web(folder / "camera");
  const std::string bytes = read_all(archive / "images/0002.jpg");
  save_picture(picture, {bytes.begin(), bytes.end()});
  const int port = free_port();
  write_file(
      folder / "station.toml",
      "name = \"quay\"\nsite_file = \"night/site.toml\"\nreference_archive = \"night\"\n[source]\nurl = \"" +
          web.url("/open/now.jpg") +
          "\"\n[schedule]\ninterval_s = 1\n[station]\ndata_directory = \"data\"\n" +
          "[http]\nport = " + std::to_string(port) + "\n");
  const NotifySocket systemd(folder / "notify");
  Serving station(folder / "station.toml", folder / "log");
  ASSERT_TRUE(eventually(20s, [&] { return ask(port, "/v1/current").status == 200; })) << station.log();
  ASSERT_TRUE(systemd.fed_within(3s));
  {
    const Frozen writer(thread_of(station.pid(), "writer")), camera(thread_of(station.pid(), "cam quay"));
    if (!writer.held() || !camera.held()) GTEST_SKIP() << "ptrace is not allowed here";
    const auto frozen = steady_clock::now();
    const auto told = [&](const std::string& why) {
      return eventually(100s, [&] {
        systemd.heard();
        return station.log().find(why) != std::string::npos;
      });
    };
    ASSERT_TRUE(
        told("no progress; the watchdog is not fed reason=\"the schedule of camera quay does not move\""))
        << station.log();
    systemd.heard();
    EXPECT_FALSE(systemd.fed_within(3s));
    ASSERT_TRUE(told("reason=\"the database's writer does not move\"")) << station.log();
    EXPECT_LT(steady_clock::now() - frozen, 75s);
    systemd.heard();
    EXPECT_FALSE(systemd.fed_within(3s));
    EXPECT_EQ(ask(port, "/healthz").status, 200) << "the others go on, and that is not enough";
  }
  EXPECT_TRUE(systemd.fed_within(10s)) << station.log();
  station.signal(SIGTERM);
  EXPECT_EQ(station.wait(5s), 0) << station.log();
}

// A worker that is amidst a frame, held, while all others go on. One that is held while it has the
// allocator's lock holds up everybody: that is another fault, so another moment is taken.
std::unique_ptr<Frozen> frozen_worker(const Serving& station, const NotifySocket& systemd, int port) {
  for (int tries = 0; tries < 5; ++tries) {
    pid_t worker = 0;
    if (!eventually(10s, [&] { return (worker = thread_of(station.pid(), "worker", true)) != 0; })) break;
    auto frozen = std::make_unique<Frozen>(worker);
    systemd.heard();
    if (!frozen->held() || (systemd.fed_within(2500ms) && ask(port, "/healthz").status == 200)) return frozen;
  }
  return nullptr;
}

TEST(Watchdog, GoesHungryForASingleWorkerThatHangs) {
  constexpr auto kWatchdog = 3s, kLongestEstimate = 2 * kWatchdog;
  const TempFolder folder;
  const fs::path archive = folder / "night";
  ASSERT_EQ(
      run_program({"simulate", archive.string(), "--style", "webcam", "--frames", "1", "--photons", "50000"})
          .exit_code,
      0);
  lengthen(archive, 5000);  // work for as long as this takes
  const int port = free_port();
  write_file(folder / "station.toml",
             "name = \"quay\"\nsite_file = \"night/site.toml\"\n[source]\nurl = \"archive:night\"\n"
             "[station]\ndata_directory = \"data\"\nworkers = 2\n[http]\nport = " +
                 std::to_string(port) + "\n");
  const NotifySocket systemd(folder / "notify", kWatchdog);
  Serving station(folder / "station.toml", folder / "log");
  ASSERT_TRUE(eventually(20s, [&] { return ask(port, "/readyz").status == 200; })) << station.log();
  ASSERT_TRUE(systemd.fed_within(3s));
  {
    const auto before = steady_clock::now();
    const auto worker = frozen_worker(station, systemd, port);
    ASSERT_TRUE(worker) << "none was busy, or all others wait for it\n" << station.log();
    if (!worker->held()) GTEST_SKIP() << "ptrace is not allowed here";
    const std::string why =
        "no progress; the watchdog is not fed reason=\"a worker does not come to an end with a frame of "
        "camera quay\"";
    auto last_fed = steady_clock::now();
    ASSERT_TRUE(eventually(kLongestEstimate + 2s, [&] {
      if (systemd.heard().find("WATCHDOG=1") != std::string::npos) last_fed = steady_clock::now();
      return station.log().find(why) != std::string::npos;
    })) << station.log();
    systemd.heard();
    EXPECT_FALSE(systemd.fed_within(3s));
    EXPECT_LT(last_fed - before, kLongestEstimate + 1s);
    EXPECT_EQ(ask(port, "/healthz").status, 200) << "the others go on, and that is not enough";
    EXPECT_EQ(station.log().find("does not move"), std::string::npos) << station.log();
  }
  EXPECT_TRUE(systemd.fed_within(5s)) << station.log();
  station.signal(SIGTERM);
  EXPECT_EQ(station.wait(5s), 0) << station.log();
}

}  // namespace
}  // namespace lampglow::testing
