// What the daemon takes of a small machine: memory with one camera of 1920x1080, processor time between two
// frames.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "tests/support/temporary_folder.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/chain/chain.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;

constexpr int kWidthPx = 1920, kHeightPx = 1080;
constexpr long kLargest_kib = 128 * 1024;

// The simulated night, stretched to 1920x1080 and with its lamps where they then are.
void enlarge(const fs::path& from, const fs::path& to) {
  fs::create_directories(to / "images");
  double scale_x = 1, scale_y = 1;
  for (const auto& entry : fs::directory_iterator(from / "images")) {
    const cv::Mat small = cv::imread(entry.path().string(), cv::IMREAD_COLOR);
    scale_x = 1.0 * kWidthPx / small.cols;
    scale_y = 1.0 * kHeightPx / small.rows;
    cv::Mat large;
    cv::resize(small, large, {kWidthPx, kHeightPx}, 0, 0, cv::INTER_CUBIC);
    ASSERT_TRUE(cv::imwrite((to / "images" / entry.path().filename()).string(), large));
  }
  fs::copy_file(from / "frames.csv", to / "frames.csv");
  std::istringstream lines(test::read_all(from / "site.toml"));
  std::string text;
  for (std::string line; std::getline(lines, line); text += line + "\n") {
    const auto number = [&](double scale) { return std::stod(line.substr(line.find('=') + 1)) * scale; };
    if (line.starts_with("width_px")) line = fmt::format("width_px = {}", kWidthPx);
    if (line.starts_with("height_px")) line = fmt::format("height_px = {}", kHeightPx);
    if (line.starts_with("principal_point_px"))
      line = fmt::format("principal_point_px = [{:.1f}, {:.1f}]", kWidthPx / 2.0, kHeightPx / 2.0);
    if (line.starts_with("x_px")) line = fmt::format("x_px = {:.1f}", number(scale_x));
    if (line.starts_with("y_px")) line = fmt::format("y_px = {:.1f}", number(scale_y));
  }
  write_file(to / "site.toml", text);
}

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
  enlarge(folder / "jpeg", folder / "large");
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
  station.reload_with(86'400);  // no frame is due: this is the time between two
  const double before = cpu_s(pid);
  std::this_thread::sleep_for(3s);
  const double used = cpu_s(pid) - before;
  std::printf("between frames: %.0f ms of processor time in 3 s\n", used * 1000);
  EXPECT_LE(used, 0.025) << "two ticks of the clock that it is measured with: less than 1 %";
}

}  // namespace
}  // namespace lampglow::testing
