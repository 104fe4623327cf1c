// The day's part of `lampglow calibrate`: targets found and learned from daylight frames of known visibility.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "daemon/sources/truth.h"
#include "estimator/site.h"

namespace lampglow::daemon {

struct DayCalibrationResult {
  bool learned = false;
  std::string report;  // for people: what was learned and how well, or why not
};

// Reads the archive's daylight frames that have a truth, finds targets where the site lists none, and writes
// what they teach into `site` (targets and [day]); the site is left alone where the data can't support it.
// Targets whose distances are known keep them; they learn their intrinsic brightness. Throws DataError,
// IoError.
DayCalibrationResult calibrate_day(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                   Site& site);

}  // namespace lampglow::daemon
