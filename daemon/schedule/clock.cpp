#include "daemon/schedule/clock.h"

#include <sys/timex.h>

#include <condition_variable>
#include <mutex>

namespace lampglow::daemon {

MonotonicTime SystemClock::monotonic() const {
  return std::chrono::steady_clock::now();
}

TimePoint SystemClock::utc() const {
  return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
}

bool SystemClock::synchronised() const {
  timex state{};
  const int result = adjtimex(&state);
  return result != -1 && result != TIME_ERROR && (state.status & STA_UNSYNC) == 0;
}

bool SystemClock::wait_until(MonotonicTime time, std::stop_token stop) {
  std::mutex mutex;
  std::unique_lock lock(mutex);
  std::condition_variable_any wake;
  wake.wait_until(lock, stop, time, [] { return false; });
  return !stop.stop_requested();
}

}  // namespace lampglow::daemon
