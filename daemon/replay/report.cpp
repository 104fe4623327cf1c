#include "daemon/replay/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <span>

#include "daemon/annotate.h"
#include "daemon/config/base64.h"
#include "daemon/replay/chart.h"
#include "daemon/replay/report_style.h"
#include "daemon/sources/archive.h"

namespace lampglow::daemon {
namespace {

constexpr std::size_t kFramesOfAKind = 3;
constexpr std::size_t kProfilesOfAFrame = 6;

std::string percent(const std::optional<double>& value) {
  return value ? fmt::format("{:.1f} %", 100 * *value) : "unknown";
}

std::string three(const std::optional<double>& value) {
  return value ? fmt::format("{:.3f}", *value) : "unknown";
}

std::string metres(const std::optional<double>& value) {
  return value ? fmt::format("{:.0f} m", *value) : "";
}

std::string estimate_text(const Observation& o) {
  if (!o.mor_m()) return "none";
  const char* word = o.limit == Limit::above ? "at least " : o.limit == Limit::below ? "at most " : "";
  return word + metres(o.mor_m());
}

// ---- the frames that are shown

struct Shown {
  std::size_t index;  // in the records and in the archive
  std::string why;
};

// How far a record is off: against the truth where there is one, else how wide its bounds are. Empty for a
// record without value.
std::optional<double> badness(const ReplayRecord& record, const std::map<TimePoint, double>& truth_m) {
  const Observation& o = record.observation;
  if (!o.mor_m() || o.limit != Limit::none || record.role != FrameRole::observation) return std::nullopt;
  if (!truth_m.empty()) {
    const auto found = truth_m.find(o.time_utc);
    if (found == truth_m.end()) return std::nullopt;
    return std::abs(std::log(*o.mor_m() / found->second));
  }
  if (!o.mor_low_m() || !o.mor_high_m()) return std::nullopt;
  return std::log(*o.mor_high_m() / *o.mor_low_m());
}

std::vector<Shown> choose_frames(const ReplayResult& result, const std::map<TimePoint, double>& truth_m) {
  std::vector<std::pair<double, std::size_t>> ranked;  // best first
  for (std::size_t i = 0; i < result.records.size(); ++i)
    if (const auto bad = badness(result.records[i], truth_m)) ranked.emplace_back(*bad, i);
  std::sort(ranked.begin(), ranked.end());
  const char* measure = truth_m.empty() ? "width of the bounds, ln" : "|ln(estimate/truth)|";
  std::vector<Shown> shown;
  const std::size_t worst = std::min(kFramesOfAKind, ranked.size());
  for (std::size_t k = 0; k < worst; ++k) {
    const auto& [bad, index] = ranked[ranked.size() - 1 - k];
    shown.push_back({index, fmt::format("Worst {}: {} {:.3f}", k + 1, measure, bad)});
  }
  const std::size_t rest = ranked.size() - worst;
  const std::size_t typical = std::min(kFramesOfAKind, rest);
  for (std::size_t k = 0; k < typical; ++k) {
    const auto& [bad, index] = ranked[std::min(rest - 1, (ranked.size() - typical) / 2 + k)];
    shown.push_back({index, fmt::format("Typical: {} {:.3f}", measure, bad)});
  }
  if (!shown.empty() || result.records.empty()) return shown;
  // No value at all: the first, the middle and the last frame show why.
  const std::size_t last = result.records.size() - 1;
  for (const std::size_t index : {std::size_t{0}, last / 2, last})
    if (shown.empty() || shown.back().index != index) shown.push_back({index, "Without a value"});
  return shown;
}

std::string profiles_html(const FrameResult& frame) {
  std::vector<const LampFit*> lamps;
  for (const LampFit& lamp : frame.lamps)
    if (!lamp.profile.theta_deg.empty()) lamps.push_back(&lamp);
  // Fitted ones first, then those with most rings; order of the catalogue among equals.
  std::stable_sort(lamps.begin(), lamps.end(), [](const LampFit* a, const LampFit* b) {
    return std::pair(a->profile.model.size(), a->profile.theta_deg.size()) >
           std::pair(b->profile.model.size(), b->profile.theta_deg.size());
  });
  std::string out;
  for (std::size_t i = 0; i < std::min(kProfilesOfAFrame, lamps.size()); ++i) {
    const LampFit& lamp = *lamps[i];
    const std::string chart = profile_chart(lamp);
    if (chart.empty()) continue;
    out += "<figure>" + chart +
           fmt::format("<figcaption><b style=\"color:{}\">{}</b> {}{}{}{}</figcaption></figure>\n",
                       state_colour(lamp.state), html_text(lamp.id), to_string(lamp.state),
                       lamp.distance_m ? fmt::format(", {:.0f} m", *lamp.distance_m) : ", distance unknown",
                       lamp.optical_thickness ? fmt::format(", T = {:.2f}", *lamp.optical_thickness) : "",
                       lamp.residual_rms ? fmt::format(", residual {:.2f}\u00a0σ", *lamp.residual_rms) : "");
  }
  return out.empty() ? "<p class=\"soft\">No ring profile was taken in this frame.</p>\n"
                     : "<div class=\"profiles\">\n" + out + "</div>\n";
}

std::string frame_html(const Shown& shown, const ReplayOptions& options, const ReplayResult& result,
                       const ArchiveSource& source, const std::map<TimePoint, double>& truth_m) {
  const Bracket bracket =
      load_bracket(options.archive, source.brackets().at(shown.index), result.site.camera);
  const FrameResult frame =
      estimate(bracket, result.site, result.reference_at(bracket.time_utc), options.estimator);
  const ReplayRecord& record = result.records[shown.index];
  const Observation& o = record.observation;
  const auto truth = truth_m.find(o.time_utc);
  std::string out = fmt::format(
      "<h3>{} — {}</h3>\n<p>Estimate {}{}{}{}. {}</p>\n", format_time_utc(o.time_utc), html_text(shown.why),
      estimate_text(o),
      o.mor_low_m() && o.mor_high_m()
          ? fmt::format(" ({} to {})", metres(o.mor_low_m()), metres(o.mor_high_m()))
          : "",
      truth == truth_m.end() ? "" : ", truth " + metres(truth->second),
      record.reason.empty() ? "" : ": " + html_text(record.reason), html_text(o.quality.to_string()));
  if (const Exposure* exposure = exposure_to_show(bracket, result.site.camera)) {
    const auto jpeg = annotated_jpeg(exposure->pixels, result.site.camera, frame.lamps, result.site.targets);
    out += fmt::format(
        "<figure><img alt=\"Annotated frame of {}\" src=\"data:image/jpeg;base64,{}\"></figure>\n",
        format_time_utc(o.time_utc), base64(jpeg));
  } else {
    out += "<p class=\"soft\">There is no picture: " + html_text(bracket.fault) + "</p>\n";
  }
  return out + profiles_html(frame);
}

std::string lamp_key() {
  std::string out = "<p class=\"key\">Lamps:";
  for (const LampState state : {LampState::seen, LampState::faded, LampState::saturated, LampState::hidden,
                                LampState::off, LampState::unknown})
    out +=
        fmt::format("<span><i style=\"background:{}\"></i>{}</span>", state_colour(state), to_string(state));
  return out +
         "</p>\n<p class=\"key\">Ring profiles: points are the measured radiance with one standard "
         "deviation, "
         "the red line is the fit.</p>\n";
}

// ---- scores and records as tables

std::string row(const std::string& name, const std::string& value) {
  return "<tr><td>" + name + "</td><td>" + value + "</td></tr>\n";
}

std::string scores_html(const Scores& s) {
  std::string out = "<table>\n";
  out += row("Records with a truth",
             fmt::format("{}: {} values, {} limits, {} without either", s.pairs, s.values, s.limits, s.none));
  out += row("Values within the WMO limits",
             fmt::format("{} ({} of {})", percent(s.within_wmo_share), s.within_wmo, s.values));
  out += row("The same share of all records", percent(s.within_wmo_share_of_all));
  out += row("Limits that the truth keeps", fmt::format("{} of {}", s.limits_right, s.limits));
  out += row("|ln(estimate/truth)|, median", three(s.median_abs_ln));
  out += row("|ln(estimate/truth)|, 95th percentile", three(s.p95_abs_ln));
  out += row("Bias, mean of ln(estimate/truth)", three(s.bias_ln));
  out += row("Truth within the 95 % bounds", fmt::format("{} of {} values", percent(s.coverage), s.bounded));
  out += row("Spearman's rank correlation", three(s.spearman));
  out += row("Fog below 1000 m, rightly told",
             fmt::format("{} (hits {}, misses {}, false alarms {}, rightly none {}, undecided {})",
                         percent(s.fog_right_share), s.fog[1][1], s.fog[1][0], s.fog[0][1], s.fog[0][0],
                         s.fog_undecided));
  return out +
         "</table>\n<p class=\"soft\">WMO limits: ±50 m up to 600 m, ±10 % up to 1500 m, ±20 % above. A "
         "limit is "
         "no value and counts in its own line. Clear references are not scored.</p>\n";
}

std::string ranges_html(const std::vector<RangeScores>& ranges) {
  std::string out =
      "<table>\n<tr><th>True MOR</th><th>Records</th><th>Values</th><th>Within "
      "WMO</th><th>Limits</th><th>Limits "
      "right</th><th>Median |ln|</th></tr>\n";
  for (const RangeScores& r : ranges) {
    if (r.scores.pairs == 0) continue;
    out += fmt::format(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>\n",
        r.high_m > 1e8 ? fmt::format("{:.0f} m and more", r.low_m)
                       : fmt::format("{:.0f} to {:.0f} m", r.low_m, r.high_m),
        r.scores.pairs, r.scores.values, r.scores.within_wmo, r.scores.limits, r.scores.limits_right,
        three(r.scores.median_abs_ln));
  }
  return out + "</table>\n";
}

std::string weather_html(const Scores& s) {
  if (s.weather_pairs == 0) return "";
  std::string out = "<h3>Weather class: truth down, estimate across</h3>\n<table>\n<tr><th></th>";
  for (int i = 0; i < 6; ++i) out += fmt::format("<th>{}</th>", to_string(static_cast<Weather>(i)));
  out += "</tr>\n";
  for (std::size_t i = 0; i < 6; ++i) {
    out += fmt::format("<tr><td>{}</td>", to_string(static_cast<Weather>(i)));
    for (const std::size_t count : s.weather[i]) out += fmt::format("<td>{}</td>", count);
    out += "</tr>\n";
  }
  return out + "</table>\n";
}

std::string records_html(const ReplayResult& result, const std::map<TimePoint, double>& truth_m) {
  std::string out =
      "<details><summary>All records</summary><div class=\"wide\"><table>\n<tr><th>Time</th><th>Truth</th>"
      "<th>Estimate</th><th>95 % bounds</th><th>q</th><th class=\"left\">Weather</th><th "
      "class=\"left\">Method</th>"
      "<th>Lamps</th><th class=\"left\">Flags, reason</th></tr>\n";
  for (const ReplayRecord& record : result.records) {
    const Observation& o = record.observation;
    const auto truth = truth_m.find(o.time_utc);
    out += fmt::format(
        "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td class=\"left\">{}</td><td "
        "class=\"left\">{}</td><td>{}</td><td class=\"left\">{} {} {}</td></tr>\n",
        format_time_utc(o.time_utc), truth == truth_m.end() ? "" : metres(truth->second), estimate_text(o),
        o.mor_low_m() || o.mor_high_m() ? metres(o.mor_low_m()) + " – " + metres(o.mor_high_m()) : "",
        o.q ? fmt::format("{:.2f}", *o.q) : "", to_string(o.weather), to_string(o.method), o.lights_used,
        html_text(o.quality.to_string()), html_text(record.reason), html_text(record.fault));
  }
  return out + "</table></div></details>\n";
}

std::string head(const ReplayResult& result) {
  std::string span = "no frames";
  if (!result.records.empty())
    span = format_time_utc(result.records.front().observation.time_utc) + " to " +
           format_time_utc(result.records.back().observation.time_utc);
  return "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         html_text(result.site.name) + " — visibility from lamps</title>\n<style>" +
         std::string(kReportStyle) + "</style></head><body>\n<h1>" + html_text(result.site.name) +
         "</h1>\n<p class=\"soft\">" + span + "</p>\n";
}

constexpr std::string_view kChartKey =
    "<p class=\"key\"><span><i style=\"background:var(--estimate)\"></i>estimate (MOR, 5 %), open dots by "
    "day's "
    "contrast</span><span><i style=\"background:var(--band)\"></i>95 % bounds</span><span>▲ at least, ▼ at "
    "most: a "
    "limit</span><span><i style=\"background:var(--truth)\"></i>truth</span><span><i "
    "style=\"background:var(--fog)\"></i>fog below 1000 m</span></p>\n";

}  // namespace

std::string format_report(const ReplayOptions& options, const ReplayResult& result,
                          const std::vector<Truth>& truths) {
  std::map<TimePoint, double> truth_m;
  for (const Truth& truth : truths)
    if (truth.mor_m) truth_m[truth.time_utc] = *truth.mor_m;
  std::vector<Observation> observations;
  for (const ReplayRecord& record : result.records) observations.push_back(record.observation);

  std::string html = head(result) + "<h2>Visibility</h2>\n" + visibility_chart(observations, truths) +
                     std::string(kChartKey) + "<pre>" + html_text(format_summary(result)) + "</pre>\n";
  if (!truths.empty()) {
    const auto pairs = match_truth(scored_observations(result), truths);
    const Scores scores = score(pairs);
    html +=
        "<h2>Scores</h2>\n" + scores_html(scores) + ranges_html(score_by_range(pairs)) + weather_html(scores);
  }
  html += "<h2>Worst and typical frames</h2>\n" + lamp_key();
  const ArchiveSource source(options.archive, result.site.camera);
  for (const Shown& shown : choose_frames(result, truth_m))
    html += frame_html(shown, options, result, source, truth_m);
  html += "<h2>Records</h2>\n" + records_html(result, truth_m);
  if (!result.warnings.empty()) {
    html += "<h2>Warnings</h2>\n<ul>\n";
    for (const std::string& warning : result.warnings) html += "<li>" + html_text(warning) + "</li>\n";
    html += "</ul>\n";
  }
  return html + "</body></html>\n";
}

}  // namespace lampglow::daemon
