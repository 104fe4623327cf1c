// The night's part of `lampglow calibrate`: what frames of known visibility teach about lamps of unknown
// distance, or about a camera of which nothing is known.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "daemon/sources/truth.h"
#include "estimator/site.h"

namespace lampglow::daemon {

struct NightCalibrationResult {
  bool learned = false;
  std::string report;  // for people: what was learned and how well, or why not
};

// Reads the archive's night frames that have a truth. With an angle of view and a clear reference (or clear
// frames), lamps without a distance get an effective one with its standard deviation; without, ln σ is
// learned from the picture's patches ([night]). `site` is left alone where the data can't support it. Throws
// DataError, IoError.
NightCalibrationResult calibrate_night(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                       Site& site);

}  // namespace lampglow::daemon
