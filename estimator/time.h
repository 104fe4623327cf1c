// Points in time: UTC, to the millisecond, as ISO 8601 text with a Z.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <string_view>

namespace lampglow {

using TimePoint = std::chrono::sys_time<std::chrono::milliseconds>;

// "2015-10-09T00:04:00Z" (a fraction of up to three digits may follow the seconds); empty if the text is
// anything else.
std::optional<TimePoint> parse_time_utc(std::string_view text);

// The same form back; milliseconds are written only where they are not zero.
std::string format_time_utc(TimePoint time);

}  // namespace lampglow
