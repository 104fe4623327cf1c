#include "estimator/time.h"

#include <gtest/gtest.h>

namespace lampglow {
namespace {

TEST(Time, RoundTrip) {
  for (const char* text : {"2015-10-09T00:04:00Z", "1970-01-01T00:00:00Z", "2024-02-29T23:59:59.250Z"})
    EXPECT_EQ(format_time_utc(parse_time_utc(text).value()), text);
}

TEST(Time, RefusesWhatIsNoTime) {
  for (const char* text : {"", "2015-10-09", "2015-10-09 00:04:00Z", "2015-02-29T00:00:00Z",
                           "2015-10-09T24:00:00Z", "2015-10-09T00:04:00", "2015-10-09T00:04:00+02:00",
                           "2015-10-09T00:04:00.Z", "2015-10-09T00:04:00Zx", "2O15-10-09T00:04:00Z"})
    EXPECT_FALSE(parse_time_utc(text)) << text;
}

TEST(Time, CountsFractionsAsMilliseconds) {
  using namespace std::chrono_literals;
  EXPECT_EQ(parse_time_utc("1970-01-01T00:00:01.5Z").value().time_since_epoch(), 1500ms);
  EXPECT_EQ(parse_time_utc("1970-01-01T00:00:01.05Z").value().time_since_epoch(), 1050ms);
}

}  // namespace
}  // namespace lampglow
