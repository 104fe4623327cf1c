#include "daemon/schedule/schedule.h"

#include "estimator/inference/sun.h"

namespace lampglow::daemon {

using std::chrono::seconds;

seconds current_interval(const ScheduleOptions& options, std::optional<double> mor_m) {
  if (mor_m && *mor_m < options.fog_mor_m) return options.in_fog.value_or(options.interval);
  if (mor_m && *mor_m > options.clear_mor_m) return options.in_clear.value_or(options.interval);
  return options.interval;
}

bool wanted(const ScheduleOptions& options, TimePoint time, const std::optional<Place>& place) {
  if (options.part == DayPart::both || !place) return true;
  const double altitude_deg =
      inference::sun_position(time, place->latitude_deg, place->longitude_deg).altitude_deg;
  const bool night = altitude_deg < options.night_below_deg;
  return night == (options.part == DayPart::night);
}

std::optional<TimePoint> next_due(const ScheduleOptions& options, TimePoint now, std::optional<double> mor_m,
                                  const std::optional<Place>& place) {
  const auto interval = std::chrono::milliseconds(current_interval(options, mor_m));
  const auto midnight = std::chrono::floor<std::chrono::days>(now);
  TimePoint due = midnight + ((now - midnight) / interval + 1) * interval;
  // Within a day the grid starts anew at midnight, also where the interval does not divide the day.
  const TimePoint next_midnight = midnight + std::chrono::days(1);
  if (due > next_midnight) due = next_midnight;
  const auto stride = std::max(interval, std::chrono::milliseconds(seconds(30)) / interval * interval);
  for (const TimePoint last = now + std::chrono::days(2); due <= last; due += stride) {
    if (wanted(options, due, place)) return due;
  }
  return std::nullopt;
}

}  // namespace lampglow::daemon
