// Prometheus' text format: base units, _total on counters, no timestamps; what is stale is left out.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"

namespace lampglow::web {

struct CameraCounters {
  static constexpr std::array<double, 8> kBuckets_s = {0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30};

  std::uint64_t with_value = 0, without_value = 0;
  std::array<std::uint64_t, 8> below{};  // frames whose estimate took at most kBuckets_s[i]
  std::uint64_t timed = 0;
  double total_s = 0;

  void count(bool value, std::optional<double> duration_s);
};

struct CameraMetrics {
  std::string name;
  bool up = false;
  CameraCounters counters;
  std::optional<TimePoint> last_observation_utc;
  std::optional<Observation> fresh;              // empty: stale or none
  std::map<std::string, std::uint64_t> tries{};  // of the source, by the fault's name; "none": good
};

struct MetricsInput {
  std::string version;
  std::vector<CameraMetrics> cameras;
  std::map<int, std::uint64_t> requests;  // by HTTP status
  int stream_clients = 0;
  std::vector<std::string> faults;  // failed parts of the station
};

std::string prometheus_text(const MetricsInput& input);

}  // namespace lampglow::web
