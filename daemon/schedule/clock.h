// Time as the schedule sees it: monotonic for intervals, UTC for stamps.
#pragma once

#include <chrono>
#include <stop_token>

#include "estimator/time.h"

namespace lampglow::daemon {

using MonotonicTime = std::chrono::steady_clock::time_point;

class Clock {
 public:
  Clock() = default;
  Clock(const Clock&) = delete;
  Clock& operator=(const Clock&) = delete;
  virtual ~Clock() = default;

  virtual MonotonicTime monotonic() const = 0;
  virtual TimePoint utc() const = 0;
  // Held by NTP or the like (adjtimex).
  virtual bool synchronised() const = 0;
  // Sleeps until then or until stopped; true if the time was reached.
  virtual bool wait_until(MonotonicTime time, std::stop_token stop) = 0;
};

// The machine's own.
class SystemClock : public Clock {
 public:
  MonotonicTime monotonic() const override;
  TimePoint utc() const override;
  bool synchronised() const override;
  bool wait_until(MonotonicTime time, std::stop_token stop) override;
};

}  // namespace lampglow::daemon
