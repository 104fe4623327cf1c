#include "web/last_hour.h"

#include <vector>

#include "storage/means.h"

namespace lampglow::web {

void LastHour::add(const Observation& observation) {
  frames_.push_back(observation);
  const TimePoint oldest = observation.time_utc - std::chrono::hours(1);
  while (frames_.front().time_utc <= oldest || frames_.front().time_utc > observation.time_utc)
    frames_.pop_front();
}

storage::ObservationRow LastHour::running_mean(int period_s) const {
  return mean_of_period(period_s, 0);
}

// The last ten minutes against the ten before, as extinction: 30 % is a change.
std::string LastHour::trend() const {
  const auto now = mean_of_period(600, 0).observation.extinction_per_m;
  const auto before = mean_of_period(600, 600).observation.extinction_per_m;
  if (!now || !before) return "";
  if (*now > 1.3 * *before) return "worsening";
  return *before > 1.3 * *now ? "improving" : "steady";
}

storage::ObservationRow LastHour::mean_of_period(int period_s, int until_s) const {
  const TimePoint end = frames_.back().time_utc - std::chrono::seconds(until_s);
  std::vector<Observation> chosen;
  for (const Observation& frame : frames_)
    if (frame.time_utc > end - std::chrono::seconds(period_s) && frame.time_utc <= end)
      chosen.push_back(frame);
  return storage::mean_of(chosen, end, period_s);
}

}  // namespace lampglow::web
