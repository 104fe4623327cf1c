#include "daemon/schedule/schedule.h"

#include <gtest/gtest.h>

namespace lampglow::daemon {
namespace {

using namespace std::chrono_literals;

TimePoint at(const char* text) {
  return parse_time_utc(text).value();
}
const Place kDeBilt{52.1, 5.18};

TEST(Schedule, DueAtMultiplesOfTheInterval) {
  ScheduleOptions options{.interval = 60s};
  EXPECT_EQ(next_due(options, at("2026-11-22T03:00:00Z"), {}, {}), at("2026-11-22T03:01:00Z"));
  EXPECT_EQ(next_due(options, at("2026-11-22T03:00:59.999Z"), {}, {}), at("2026-11-22T03:01:00Z"));
  options.interval = 7s;  // does not divide the day: starts anew at midnight
  EXPECT_EQ(next_due(options, at("2026-11-22T23:59:59Z"), {}, {}), at("2026-11-23T00:00:00Z"));
}

TEST(Schedule, FasterInFogSlowerInClearAir) {
  const ScheduleOptions options{.interval = 60s, .in_fog = 15s, .in_clear = 300s};
  EXPECT_EQ(current_interval(options, 400.0), 15s);
  EXPECT_EQ(current_interval(options, 4000.0), 60s);
  EXPECT_EQ(current_interval(options, 14000.0), 300s);
  EXPECT_EQ(current_interval(options, {}), 60s);
  EXPECT_EQ(next_due(options, at("2026-11-22T03:01:00Z"), 14000.0, {}), at("2026-11-22T03:05:00Z"));
}

TEST(Schedule, NightOnlyWaitsForTheSunToSet) {
  const ScheduleOptions options{.interval = 60s, .part = DayPart::night};
  EXPECT_TRUE(wanted(options, at("2015-10-09T00:00:00Z"), kDeBilt));
  EXPECT_FALSE(wanted(options, at("2015-10-09T12:00:00Z"), kDeBilt));
  // End of civil twilight at De Bilt on 2015-10-09: 17:31 UTC (sunset 16:58).
  const auto due = next_due(options, at("2015-10-09T12:00:00Z"), {}, kDeBilt);
  ASSERT_TRUE(due);
  EXPECT_GE(*due, at("2015-10-09T17:25:00Z"));
  EXPECT_LE(*due, at("2015-10-09T17:40:00Z"));
}

TEST(Schedule, DayIsTheComplementOfNight) {
  ScheduleOptions night{.part = DayPart::night}, day{.part = DayPart::day};
  for (TimePoint time = at("2015-10-09T00:00:00Z"); time < at("2015-10-10T00:00:00Z"); time += 10min) {
    EXPECT_NE(wanted(night, time, kDeBilt), wanted(day, time, kDeBilt)) << format_time_utc(time);
  }
}

TEST(Schedule, PolarDayHasNoNight) {
  const ScheduleOptions options{.part = DayPart::night};
  EXPECT_FALSE(next_due(options, at("2026-06-21T12:00:00Z"), {}, Place{78.2, 15.6}));
}

}  // namespace
}  // namespace lampglow::daemon
