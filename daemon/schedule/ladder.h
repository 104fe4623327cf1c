// When to try a failing camera again: 5 x 1 s, 5 x 5 s, 10 x 10 s, then every 60 s, each with jitter so that
// many stations do not hit one camera server at the same moment.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>

namespace lampglow::daemon {

class ReconnectLadder {
 public:
  explicit ReconnectLadder(std::uint64_t seed) : random_(seed) {}

  // The wait before the next try, after one more failure. Within +-20 % of the rung.
  std::chrono::milliseconds next_delay();
  void reset() { failures_ = 0; }
  int failures() const { return failures_; }

  // The rung without jitter for the n-th failure running, n = 1, 2, ...
  static std::chrono::milliseconds rung(int failures);

 private:
  int failures_ = 0;
  std::mt19937_64 random_;
};

}  // namespace lampglow::daemon
