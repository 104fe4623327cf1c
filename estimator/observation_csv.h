// An observation as one line of CSV: the form of replay's and export's files.
#pragma once

#include <string>
#include <string_view>

#include "estimator/observation.h"

namespace lampglow {

// MOR in metres with its 95 % bounds; limit is empty, above (at least mor_m) or below; quality is a ;-list.
inline constexpr std::string_view kObservationCsvHeader =
    "time_utc,mor_m,mor_low_m,mor_high_m,limit,extinction_per_m,q,q_low,q_high,weather,method,lights_used,"
    "quality";

// Without a line end. Unknown is an empty field; numbers have six significant digits.
std::string format_observation_csv(const Observation& observation);

}  // namespace lampglow
