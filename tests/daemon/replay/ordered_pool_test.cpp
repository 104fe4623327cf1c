#include "daemon/replay/ordered_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <random>
#include <stdexcept>

namespace lampglow::daemon {
namespace {

using Pool = OrderedPool<int, int>;

// 0, 1, ... count-1.
Pool::Produce numbers(int count) {
  return [next = 0, count](const std::stop_token&) mutable -> std::optional<int> {
    if (next == count) return std::nullopt;
    return next++;
  };
}

// Work that takes an uneven time, so that results arrive out of order.
int slow_square(int value) {
  std::this_thread::sleep_for(std::chrono::microseconds((value * 7919) % 300));
  return value * value;
}

TEST(OrderedPool, ResultsComeInOrderForAnyNumberOfWorkers) {
  for (const std::size_t workers : {1U, 2U, 3U, 8U}) {
    std::vector<int> results;
    Pool pool(numbers(200), slow_square, [&](int&& result) { results.push_back(result); }, {workers, 0});
    EXPECT_EQ(pool.run({}), 200U);
    ASSERT_EQ(results.size(), 200U);
    for (int i = 0; i < 200; ++i) ASSERT_EQ(results[static_cast<std::size_t>(i)], i * i) << workers;
  }
}

TEST(OrderedPool, NoMoreIsInMemoryThanTheCapacity) {
  std::atomic<int> taken = 0, done = 0;
  int most = 0;
  Pool pool(
      [&](const std::stop_token&) -> std::optional<int> {
        if (taken == 100) return std::nullopt;
        return taken++;
      },
      slow_square,
      [&](int&&) {
        std::this_thread::sleep_for(std::chrono::microseconds(200));
        most = std::max(most, taken - done);
        ++done;
      },
      {4, 6});
  pool.run({});
  EXPECT_LE(most, 6);
  EXPECT_GE(most, 2) << "the pool never worked ahead";
}

TEST(OrderedPool, AStopLeavesAPrefixWithoutGap) {
  std::stop_source stop;
  std::vector<int> results;
  int produced = 0;
  Pool pool(
      [&](const std::stop_token& token) -> std::optional<int> {
        if (token.stop_requested()) return std::nullopt;
        return produced++;
      },
      slow_square,
      [&](int&& result) {
        results.push_back(result);
        if (results.size() == 20) stop.request_stop();
      },
      {3, 0});
  pool.run(stop.get_token());
  EXPECT_EQ(results.size(), static_cast<std::size_t>(produced)) << "what was taken is finished";
  EXPECT_GE(results.size(), 20U);
  EXPECT_LE(results.size(), 27U) << "not much is begun after the stop";
  for (std::size_t i = 0; i < results.size(); ++i) EXPECT_EQ(results[i], static_cast<int>(i * i));
}

TEST(OrderedPool, TheFirstErrorEndsTheRunAfterTheResultsBeforeIt) {
  for (const int where : {0, 1, 2}) {  // in the source, a worker, the writer
    std::vector<int> results;
    Pool pool(
        [&, next = 0](const std::stop_token&) mutable -> std::optional<int> {
          if (where == 0 && next == 10) throw std::runtime_error("at 10");
          return next++;
        },
        [&](int&& value) {
          if (where == 1 && value == 10) throw std::runtime_error("at 10");
          return slow_square(value);
        },
        [&](int&& result) {
          if (where == 2 && result == 100) throw std::runtime_error("at 10");
          results.push_back(result);
        },
        {4, 0});
    try {
      pool.run({});
      ADD_FAILURE() << "no error came through";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "at 10");
    }
    EXPECT_EQ(results.size(), 10U) << where;
  }
}

TEST(OrderedPool, AnEmptySourceIsNoProblem) {
  Pool pool(numbers(0), slow_square, [](int&&) { FAIL(); }, {4, 0});
  EXPECT_EQ(pool.run({}), 0U);
}

}  // namespace
}  // namespace lampglow::daemon
