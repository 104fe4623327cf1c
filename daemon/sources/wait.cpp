#include "daemon/sources/wait.h"

#include <poll.h>
#include <sys/eventfd.h>

#include <algorithm>
#include <cerrno>
#include <system_error>

#include "daemon/config/descriptor.h"

namespace lampglow::daemon {
namespace {

int milliseconds_until(std::chrono::steady_clock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - std::chrono::steady_clock::now());
  return static_cast<int>(std::clamp<std::chrono::milliseconds::rep>(left.count(), 0, 3'600'000));
}

}  // namespace

Wait wait_readable(int fd, std::chrono::steady_clock::time_point deadline, std::stop_token stop) {
  const Descriptor wake(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  if (!wake.good()) throw std::system_error(errno, std::generic_category(), "eventfd");
  const std::stop_callback on_stop(stop, [&wake] { ::eventfd_write(wake.get(), 1); });
  for (;;) {
    pollfd waits[2]{{fd, POLLIN, 0}, {wake.get(), POLLIN, 0}};
    const int count = ::poll(waits, 2, milliseconds_until(deadline));
    if (waits[1].revents != 0 || stop.stop_requested()) return Wait::stopped;
    if (count > 0) return Wait::ready;
    if (count < 0 && errno != EINTR) throw std::system_error(errno, std::generic_category(), "poll");
    if (std::chrono::steady_clock::now() >= deadline) return Wait::timeout;
  }
}

}  // namespace lampglow::daemon
