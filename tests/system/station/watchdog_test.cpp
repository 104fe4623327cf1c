// The watchdog is fed by progress alone: single threads of a running station are frozen with ptrace, as a
// driver or a disk that never answers would freeze them, while all others go on.
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "tests/support/run_program.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using std::chrono::steady_clock;
using test::read_all;
using test::run_program;

// What systemd would hear.
class NotifySocket {
 public:
  explicit NotifySocket(const fs::path& path) : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof address.sun_path - 1);
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      ADD_FAILURE() << "no socket at " << path;
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
    ::setenv("WATCHDOG_USEC", "60000000", 1);
  }
  ~NotifySocket() {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::close(socket_);
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  // All that was said since the last call. Who does not listen makes the program wait.
  std::string heard() const {
    std::string all;
    char buffer[4096];
    for (ssize_t n = 0; (n = ::recv(socket_, buffer, sizeof buffer, 0)) > 0;)
      all.append(buffer, static_cast<std::size_t>(n)) += '\n';
    return all;
  }
  bool fed_within(std::chrono::milliseconds limit) const {
    return eventually(limit, [&] { return heard().find("WATCHDOG=1") != std::string::npos; });
  }

 private:
  int socket_;
};

// Holds one thread of a child process, by the thread's name.
class Frozen {
 public:
  Frozen(pid_t process, const std::string& name) {
    for (const auto& task : fs::directory_iterator("/proc/" + std::to_string(process) + "/task"))
      if (read_all(task.path() / "comm") == name + "\n") thread_ = std::stoi(task.path().filename());
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
    const Frozen writer(station.pid(), "writer"), camera(station.pid(), "cam quay");
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

}  // namespace
}  // namespace lampglow::testing
