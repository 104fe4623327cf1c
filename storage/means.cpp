#include "storage/means.h"

#include <algorithm>
#include <functional>

namespace lampglow::storage {
namespace {

using Field = std::optional<double> Observation::*;

std::optional<double> mean_where_known(std::span<const Observation> frames, Field field) {
  double sum = 0;
  int count = 0;
  for (const Observation& frame : frames) {
    if (!(frame.*field)) continue;
    sum += *(frame.*field);
    ++count;
  }
  return count ? std::optional<double>(sum / count) : std::nullopt;
}

// An `above` says that σ is anywhere from 0 to its bound.
std::optional<double> low_of(const Observation& frame) {
  return frame.limit == Limit::above ? 0.0 : frame.extinction_low_per_m;
}
// A `below` has no upper bound.
std::optional<double> high_of(const Observation& frame) {
  if (frame.limit == Limit::below) return std::nullopt;
  return frame.limit == Limit::above ? frame.extinction_per_m : frame.extinction_high_per_m;
}

// Mean over the frames that have a value; empty as soon as one of them lacks the bound.
template <typename Bound>
std::optional<double> mean_bound(std::span<const Observation> frames, int values, Bound bound) {
  double sum = 0;
  for (const Observation& frame : frames) {
    if (!frame.extinction_per_m) continue;
    const std::optional<double> value = bound(frame);
    if (!value) return std::nullopt;
    sum += *value;
  }
  return values ? std::optional<double>(sum / values) : std::nullopt;
}

Limit mean_limit(std::span<const Observation> frames) {
  double above = 0, all = 0;
  for (const Observation& frame : frames) {
    if (!frame.extinction_per_m) continue;
    if (frame.limit == Limit::below) return Limit::below;
    all += *frame.extinction_per_m;
    if (frame.limit == Limit::above) above += *frame.extinction_per_m;
  }
  return all > 0 && above >= 0.5 * all ? Limit::above : Limit::none;
}

Weather most_frequent(std::span<const Observation> frames) {
  std::array<int, 6> count{};
  for (const Observation& frame : frames) ++count[static_cast<size_t>(frame.weather)];
  count[0] = 0;
  const auto most = std::max_element(count.begin(), count.end());
  return *most ? static_cast<Weather>(most - count.begin()) : Weather::unknown;
}

}  // namespace

TimePoint period_end(TimePoint time, int period_s) {
  const std::chrono::milliseconds period = std::chrono::seconds{period_s};
  const auto since = time.time_since_epoch();
  auto periods = since / period;
  if (since > periods * period) ++periods;
  return TimePoint{periods * period};
}

ObservationRow mean_of(std::span<const Observation> frames, TimePoint end, int period_s) {
  ObservationRow mean;
  Observation& o = mean.observation;
  o.time_utc = end;
  mean.period_s = period_s;
  mean.frames = static_cast<int>(frames.size());
  mean.values = static_cast<int>(std::count_if(frames.begin(), frames.end(),
                                               [](const auto& f) { return f.extinction_per_m.has_value(); }));
  for (const Observation& frame : frames) {
    o.quality.set(frame.quality);
    o.lights_used = std::max(o.lights_used, frame.lights_used);
    if (frame.extinction_per_m) o.method = frame.method;
  }
  o.extinction_per_m = mean_where_known(frames, &Observation::extinction_per_m);
  o.limit = mean_limit(frames);
  // The bounds of a limit are the limit itself.
  if (o.limit == Limit::none) {
    o.extinction_low_per_m = mean_bound(frames, mean.values, low_of);
    o.extinction_high_per_m = mean_bound(frames, mean.values, high_of);
  }
  o.q = mean_where_known(frames, &Observation::q);
  o.q_low = mean_where_known(frames, &Observation::q_low);
  o.q_high = mean_where_known(frames, &Observation::q_high);
  o.relative_humidity = mean_where_known(frames, &Observation::relative_humidity);
  o.weather = most_frequent(frames);
  return mean;
}

}  // namespace lampglow::storage
