// When the next picture is due: by night, by day or both, faster in fog and slower in clear air.
#pragma once

#include <chrono>
#include <optional>

#include "estimator/time.h"

namespace lampglow::daemon {

enum class DayPart { night, day, both };

struct ScheduleOptions {
  std::chrono::seconds interval{60};               // 1 s .. 1 d
  std::optional<std::chrono::seconds> in_fog{};    // while MOR is below fog_mor_m; empty: interval
  std::optional<std::chrono::seconds> in_clear{};  // while MOR is above clear_mor_m; empty: interval
  double fog_mor_m = 1000;
  double clear_mor_m = 10000;
  DayPart part = DayPart::both;
  double night_below_deg = -6;  // it is night while the sun is lower than this (civil twilight's end)
};

struct Place {
  double latitude_deg = 0;
  double longitude_deg = 0;
};

// The interval that holds for air of this MOR; empty: not known.
std::chrono::seconds current_interval(const ScheduleOptions& options, std::optional<double> mor_m);

// Whether a picture is wanted at this time. Without a place every time is wanted.
bool wanted(const ScheduleOptions& options, TimePoint time, const std::optional<Place>& place);

// The first due time after `now`: a multiple of the interval since midnight UTC (so that stations agree and a
// restart does not shift the record) at which a picture is wanted. Looks at most two days ahead; empty if
// none is wanted in that time (polar day or night).
std::optional<TimePoint> next_due(const ScheduleOptions& options, TimePoint now, std::optional<double> mor_m,
                                  const std::optional<Place>& place);

}  // namespace lampglow::daemon
