// The time that retention goes by: the system's, but not wherever a wrong clock jumps to. What it drops is
// gone.
#pragma once

#include <chrono>
#include <optional>

#include "estimator/time.h"

namespace lampglow::daemon {

// Begins at the newest stored frame's time and follows the system's clock by at most a day for each hour that
// passes. So a clock that is a year ahead for an hour costs the oldest day, and a station that was off for
// two years is back at the system's time within a month. A clock that goes back is followed at once.
class RetentionClock {
 public:
  using Monotonic = std::chrono::steady_clock::time_point;

  // `newest`: of the frames that are stored; empty: there is nothing that could be dropped.
  void begin(std::optional<TimePoint> newest) {
    time_ = newest;
    seen_.reset();
  }
  // The time to go by, never after `utc`.
  TimePoint follow(TimePoint utc, Monotonic now);
  // How far the system's clock is ahead of it, as of the last follow().
  std::chrono::milliseconds behind() const { return behind_; }

 private:
  std::optional<TimePoint> time_;
  std::optional<Monotonic> seen_;
  std::chrono::milliseconds behind_{0};
};

}  // namespace lampglow::daemon
