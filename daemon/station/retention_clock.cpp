#include "daemon/station/retention_clock.h"

#include <algorithm>

namespace lampglow::daemon {

TimePoint RetentionClock::follow(TimePoint utc, Monotonic now) {
  constexpr int kTimesAsFast = 24;
  // The first frame since a short stop is no reason to lag.
  constexpr std::chrono::hours kNoJump{24};
  if (!time_) time_ = utc;
  if (!seen_) *time_ += kNoJump;
  const auto passed = std::chrono::duration_cast<std::chrono::milliseconds>(now - seen_.value_or(now));
  seen_ = now;
  time_ = std::min(utc, *time_ + kTimesAsFast * passed);
  behind_ = utc - *time_;
  return *time_;
}

}  // namespace lampglow::daemon
