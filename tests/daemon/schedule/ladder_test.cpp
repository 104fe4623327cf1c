#include "daemon/schedule/ladder.h"

#include <gtest/gtest.h>

namespace lampglow::daemon {
namespace {

using namespace std::chrono_literals;

TEST(ReconnectLadder, ClimbsAsTheConventionsSay) {
  ReconnectLadder ladder(7);
  for (int failure = 1; failure <= 40; ++failure) {
    const std::chrono::milliseconds rung = failure <= 5 ? 1s : failure <= 10 ? 5s : failure <= 20 ? 10s : 60s;
    const auto delay = ladder.next_delay();
    EXPECT_GE(delay, rung * 8 / 10) << failure;
    EXPECT_LE(delay, rung * 12 / 10) << failure;
  }
}

TEST(ReconnectLadder, JitterSpreadsStationsAndIsRepeatable) {
  ReconnectLadder one(1), again(1), other(2);
  int different = 0;
  for (int i = 0; i < 20; ++i) {
    const auto delay = one.next_delay();
    EXPECT_EQ(delay, again.next_delay());
    different += delay != other.next_delay();
  }
  EXPECT_GT(different, 15);
}

TEST(ReconnectLadder, StartsAnewAfterSuccess) {
  ReconnectLadder ladder(1);
  for (int i = 0; i < 30; ++i) ladder.next_delay();
  ladder.reset();
  EXPECT_LE(ladder.next_delay(), 1200ms);
}

}  // namespace
}  // namespace lampglow::daemon
