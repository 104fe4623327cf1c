// truth.csv: what a sensor beside the camera said.
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "estimator/observation.h"
#include "estimator/time.h"

namespace lampglow::daemon {

struct Truth {
  TimePoint time_utc{};
  std::optional<double> mor_m;  // empty: the sensor gave none
  std::optional<double> period_s;
  std::optional<double> q;
  std::optional<Weather> weather;
};

// Columns time_utc, mor_m; optionally period_s, q, weather; others are ignored. Given in order of
// time, each time once; one time with two values is refused. Throws DataError with every problem, IoError.
std::vector<Truth> read_truth(const std::filesystem::path& path);

}  // namespace lampglow::daemon
