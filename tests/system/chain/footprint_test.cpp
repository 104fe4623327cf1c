// What the daemon takes of a small machine: memory with one camera of 1920x1080, processor time between two
// frames.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <sstream>

#include "tests/support/enlarged_archive.h"
#include "tests/support/temporary_folder.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/chain/chain.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;

constexpr long kLargest_kib = 128L * 1024;

// A line "NAME:   123 kB" of /proc/PID/status, in KiB.
long status_kib(pid_t pid, const std::string& name) {
  std::ifstream status(fmt::format("/proc/{}/status", pid));
  for (std::string line; std::getline(status, line);)
    if (line.starts_with(name + ":")) return std::stol(line.substr(name.size() + 1));
  return -1;
}

// User and system time of all threads, s.
double cpu_s(pid_t pid) {
  std::istringstream fields(test::read_all(fmt::format("/proc/{}/stat", pid)));
  std::string field;
  for (int i = 1; i < 14; ++i) fields >> field;
  double user = 0, system = 0;
  fields >> user >> system;
  return (user + system) / static_cast<double>(sysconf(_SC_CLK_TCK));
}

TEST(Footprint, MemoryWithA1080pCameraAndProcessorTimeBetweenFrames) {
  if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
  const TempFolder folder;
  make_night(folder.path());
  test::enlarge_archive(folder / "jpeg", folder / "large", {1920, 1080});
  const Night night{folder / "large", {}, {}};
  const Lighttpd server(folder / "camera");
  const ChainStation station(folder / "station", night.archive,
                             fmt::format("url = \"{}\"", server.url("/open/now.jpg")), 5);
  const pid_t pid = station.serving().pid();
  const auto values = [&] {
    std::size_t count = 0;
    for (const auto& row : station.stored()) count += row.observation.extinction_per_m.has_value();
    return count;
  };
  for (int frame = 0; frame < 4; ++frame) {
    const std::string bytes = test::read_all(night.archive / fmt::format("images/{:04}.jpg", 2 + frame));
    save_picture(folder / "camera/www/open/now.jpg", {bytes.begin(), bytes.end()});
    const std::size_t before = values();
    ASSERT_TRUE(eventually(40s, [&] { return values() > before; })) << station.log();
    // The writer gives back what the frame needed just after it was stored; on a busy machine the next one
    // may have begun.
    const bool small = eventually(10s, [&] { return status_kib(pid, "VmRSS") <= kLargest_kib; });
    std::printf("after frame %d: RSS %.1f MiB (anonymous %.1f MiB), peak %.1f MiB\n", frame + 1,
                status_kib(pid, "VmRSS") / 1024.0, status_kib(pid, "RssAnon") / 1024.0,
                status_kib(pid, "VmHWM") / 1024.0);
    EXPECT_TRUE(small) << status_kib(pid, "VmRSS") << " KiB";
  }
  EXPECT_LE(status_kib(pid, "VmHWM"), kLargest_kib) << "at the peak, the start included";
  station.reload_with(86'400);  // no frame is due: this is the time between two
  const double before = cpu_s(pid);
  std::this_thread::sleep_for(3s);
  const double used = cpu_s(pid) - before;
  std::printf("between frames: %.0f ms of processor time in 3 s\n", used * 1000);
  EXPECT_LE(used, 0.025) << "two ticks of the clock that it is measured with: less than 1 %";
}

}  // namespace
}  // namespace lampglow::testing
