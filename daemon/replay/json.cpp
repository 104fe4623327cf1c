// The result of a replay and its scores as JSON. Unknown is null.
#include <boost/json.hpp>

#include "daemon/replay/replay.h"

namespace lampglow::daemon {
namespace {

namespace json = boost::json;

json::value number(const std::optional<double>& value) {
  return value ? json::value(*value) : json::value(nullptr);
}

json::object record_json(const ReplayRecord& record) {
  const Observation& o = record.observation;
  json::object out;
  out["time_utc"] = format_time_utc(o.time_utc);
  out["role"] = record.role == FrameRole::observation ? "observation" : "clear_reference";
  out["mor_m"] = number(o.mor_m());
  out["mor_low_m"] = number(o.mor_low_m());
  out["mor_high_m"] = number(o.mor_high_m());
  out["limit"] = o.limit == Limit::none ? json::value(nullptr) : json::value(to_string(o.limit));
  out["extinction_per_m"] = number(o.extinction_per_m);
  out["q"] = number(o.q);
  out["q_low"] = number(o.q_low);
  out["q_high"] = number(o.q_high);
  out["weather"] = to_string(o.weather);
  out["method"] = to_string(o.method);
  out["lights_used"] = o.lights_used;
  json::array flags;
  for (const QualityFlag& entry : quality_registry())
    if (o.quality.has(entry.flag)) flags.emplace_back(entry.name);
  out["quality"] = std::move(flags);
  out["reason"] = record.reason.empty() ? json::value(nullptr) : json::value(record.reason);
  out["fault"] = record.fault.empty() ? json::value(nullptr) : json::value(record.fault);
  return out;
}

json::object weather_json(const Scores& scores) {
  json::object rows;
  for (std::size_t truth = 0; truth < 6; ++truth) {
    json::object row;
    for (std::size_t estimate = 0; estimate < 6; ++estimate)
      row[to_string(static_cast<Weather>(estimate))] = scores.weather[truth][estimate];
    rows[to_string(static_cast<Weather>(truth))] = std::move(row);
  }
  return rows;
}

json::object scores_json(const Scores& s) {
  json::object out;
  out["pairs"] = s.pairs;
  out["values"] = s.values;
  out["limits"] = s.limits;
  out["none"] = s.none;
  out["within_wmo"] = s.within_wmo;
  out["within_wmo_share"] = number(s.within_wmo_share);
  out["within_wmo_share_of_all"] = number(s.within_wmo_share_of_all);
  out["limits_right"] = s.limits_right;
  out["median_abs_ln"] = number(s.median_abs_ln);
  out["p95_abs_ln"] = number(s.p95_abs_ln);
  out["bias_ln"] = number(s.bias_ln);
  out["bounded"] = s.bounded;
  out["coverage_95"] = number(s.coverage);
  out["spearman"] = number(s.spearman);
  out["fog_1000_m"] = {{"hits", s.fog[1][1]},          {"misses", s.fog[1][0]},
                       {"false_alarms", s.fog[0][1]},  {"rightly_none", s.fog[0][0]},
                       {"undecided", s.fog_undecided}, {"right_share", number(s.fog_right_share)}};
  out["weather_truth_estimate"] = s.weather_pairs == 0 ? json::value(nullptr) : json::value(weather_json(s));
  out["weather_right_share"] = number(s.weather_right_share);
  return out;
}

json::object all_scores(const ReplayResult& result, const std::vector<Truth>& truths) {
  const auto pairs = match_truth(scored_observations(result), truths);
  json::object out = scores_json(score(pairs));
  json::array ranges;
  for (const RangeScores& range : score_by_range(pairs)) {
    json::object entry{
        {"true_mor_low_m", range.low_m},
        {"true_mor_high_m", range.high_m > 1e8 ? json::value(nullptr) : json::value(range.high_m)}};
    entry["scores"] = scores_json(range.scores);
    ranges.push_back(std::move(entry));
  }
  out["by_true_mor"] = std::move(ranges);
  return out;
}

}  // namespace

std::string format_scores_json(const ReplayResult& result, const std::vector<Truth>& truths) {
  return json::serialize(all_scores(result, truths)) + "\n";
}

std::string format_json(const ReplayResult& result, const std::vector<Truth>& truths) {
  json::object out;
  out["site"] = result.site.name;
  out["frames"] = result.frames;
  out["stopped"] = result.stopped;
  json::array records;
  for (const ReplayRecord& record : result.records) records.push_back(record_json(record));
  out["records"] = std::move(records);
  json::array warnings;
  for (const std::string& warning : result.warnings) warnings.emplace_back(warning);
  out["warnings"] = std::move(warnings);
  out["scores"] = truths.empty() ? json::value(nullptr) : json::value(all_scores(result, truths));
  return json::serialize(out) + "\n";
}

}  // namespace lampglow::daemon
