#include "daemon/station/notify.h"

#include <systemd/sd-daemon.h>

#include <ctime>

namespace lampglow::daemon {

void notify_ready() {
  sd_notify(0, "READY=1");
}

void notify_reloading() {
  timespec now{};
  clock_gettime(CLOCK_MONOTONIC, &now);
  sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%lld",
             static_cast<long long>(now.tv_sec) * 1000000 + now.tv_nsec / 1000);
}

void notify_stopping() {
  sd_notify(0, "STOPPING=1");
}

void notify_status(const std::string& text) {
  sd_notifyf(0, "STATUS=%s", text.c_str());
}

void notify_watchdog() {
  sd_notify(0, "WATCHDOG=1");
}

void notify_progress() {
  using std::chrono::steady_clock;
  static thread_local steady_clock::time_point told;
  const steady_clock::time_point now = steady_clock::now();
  if (now - told < std::chrono::seconds(1)) return;
  told = now;
  sd_notify(0, "WATCHDOG=1\nEXTEND_TIMEOUT_USEC=60000000");
}

void notify_long_step(std::chrono::seconds at_most) {
  sd_notifyf(0, "EXTEND_TIMEOUT_USEC=%lld",
             static_cast<long long>(std::chrono::microseconds(at_most).count()));
}

std::optional<std::chrono::microseconds> watchdog_period() {
  std::uint64_t usec = 0;
  if (sd_watchdog_enabled(0, &usec) <= 0) return std::nullopt;
  return std::chrono::microseconds(usec);
}

}  // namespace lampglow::daemon
