// The result of a replay as text for people.
#include <fmt/format.h>

#include <map>

#include "daemon/replay/reference_log.h"
#include "daemon/replay/replay.h"

namespace lampglow::daemon {
namespace {

std::string metres(const std::optional<double>& value) {
  return value ? fmt::format("{:.0f}", *value) : "";
}

// "> 12000" for a limit.
std::string estimate_text(const Observation& observation) {
  const char* sign = observation.limit == Limit::above ? ">" : observation.limit == Limit::below ? "<" : "";
  return observation.mor_m() ? sign + metres(observation.mor_m()) : "-";
}

std::string bounds_text(const Observation& observation) {
  const auto low = observation.mor_low_m(), high = observation.mor_high_m();
  return low || high ? metres(low) + ".." + metres(high) : "";
}

std::string table_row(const ReplayRecord& record, const std::optional<double>& truth_m) {
  const Observation& o = record.observation;
  std::string remark = o.quality.to_string();
  if (record.role == FrameRole::clear_reference) remark = "[clear reference] " + remark;
  return fmt::format("{:<20} {:>8} {:>8} {:>15} {:>5} {:<8} {:<8} {:>5}  {}\n", format_time_utc(o.time_utc),
                     metres(truth_m), estimate_text(o), bounds_text(o),
                     o.q ? fmt::format("{:.2f}", *o.q) : "", to_string(o.weather), to_string(o.method),
                     o.lights_used, remark);
}

}  // namespace

std::string format_table(const ReplayResult& result, const std::vector<Truth>& truths) {
  std::map<TimePoint, std::optional<double>> truth_m;
  for (const Truth& truth : truths) truth_m[truth.time_utc] = truth.mor_m;
  std::string text = fmt::format("{:<20} {:>8} {:>8} {:>15} {:>5} {:<8} {:<8} {:>5}  {}\n", "time", "truth_m",
                                 "mor_m", "95 % bounds", "q", "weather", "method", "lamps", "flags");
  for (const ReplayRecord& record : result.records) {
    const auto found = truth_m.find(record.observation.time_utc);
    text += table_row(record, found == truth_m.end() ? std::nullopt : found->second);
  }
  return text;
}

std::string format_summary(const ReplayResult& result) {
  std::size_t values = 0, limits = 0, faults = 0;
  std::map<std::string, std::size_t> reasons;
  for (const ReplayRecord& record : result.records) {
    faults += !record.fault.empty();
    if (!record.observation.mor_m())
      ++reasons[record.reason.empty() ? "no reason given" : record.reason];
    else
      ++(record.observation.limit == Limit::none ? values : limits);
  }
  std::string text = fmt::format(
      "{} of {} frames done: {} values, {} limits, {} without a value; {} bad frames{}\n",
      result.records.size(), result.frames, values, limits, result.records.size() - values - limits, faults,
      result.stopped ? "; stopped before the end" : "");
  for (const auto& [reason, count] : reasons)
    text += fmt::format("  {:4} without a value: {}\n", count, reason);
  for (const RelearnedReference& step : result.relearned)
    text += fmt::format("{}: {}\n", format_time_utc(step.settled.valid_from),
                        lesson_text(*step.reference, step.settled));
  return text;
}

}  // namespace lampglow::daemon
