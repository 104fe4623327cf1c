#include "daemon/replay/scores.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace lampglow::daemon {
namespace {

constexpr double kFogMor_m = 1000;

std::optional<double> share(std::size_t part, std::size_t whole) {
  if (whole == 0) return std::nullopt;
  return static_cast<double>(part) / static_cast<double>(whole);
}

bool is_value(const Observation& estimate) {
  return estimate.mor_m() && estimate.limit == Limit::none;
}

bool limit_holds(const Observation& estimate, double true_mor_m) {
  return estimate.limit == Limit::above ? true_mor_m >= *estimate.mor_m() : true_mor_m <= *estimate.mor_m();
}

// Does the estimate say fog? Empty where it does not decide.
std::optional<bool> says_fog(const Observation& estimate) {
  const auto mor_m = estimate.mor_m();
  if (!mor_m) return std::nullopt;
  if (estimate.limit == Limit::none) return *mor_m < kFogMor_m;
  if (estimate.limit == Limit::above && *mor_m >= kFogMor_m) return false;
  if (estimate.limit == Limit::below && *mor_m <= kFogMor_m) return true;
  return std::nullopt;
}

// Ranks from 1; equal values share the mean of their ranks.
std::vector<double> ranks(const std::vector<double>& values) {
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  std::vector<double> rank(values.size());
  for (std::size_t first = 0; first < order.size();) {
    std::size_t last = first;
    while (last + 1 < order.size() && values[order[last + 1]] == values[order[first]]) ++last;
    for (std::size_t i = first; i <= last; ++i) rank[order[i]] = 1 + static_cast<double>(first + last) / 2;
    first = last + 1;
  }
  return rank;
}

void count_kind(const ScoredPair& pair, Scores& scores) {
  const double truth_m = *pair.truth.mor_m;
  if (!pair.estimate.mor_m()) {
    ++scores.none;
  } else if (pair.estimate.limit != Limit::none) {
    ++scores.limits;
    scores.limits_right += limit_holds(pair.estimate, truth_m);
  } else {
    ++scores.values;
    scores.within_wmo += std::abs(*pair.estimate.mor_m() - truth_m) <= wmo_allowed_error_m(truth_m);
  }
}

void count_fog(const ScoredPair& pair, Scores& scores) {
  if (const auto fog = says_fog(pair.estimate))
    ++scores.fog[*pair.truth.mor_m < kFogMor_m][*fog];
  else
    ++scores.fog_undecided;
}

void count_weather(const ScoredPair& pair, Scores& scores) {
  if (!pair.truth.weather) return;
  ++scores.weather_pairs;
  ++scores.weather[static_cast<std::size_t>(*pair.truth.weather)]
                  [static_cast<std::size_t>(pair.estimate.weather)];
}

void score_values(const std::vector<ScoredPair>& pairs, Scores& scores) {
  std::vector<double> ln_ratio, abs_ln, estimates, truths;
  std::size_t covered = 0;
  for (const auto& [estimate, truth] : pairs) {
    if (!is_value(estimate)) continue;
    estimates.push_back(*estimate.mor_m());
    truths.push_back(*truth.mor_m);
    ln_ratio.push_back(std::log(estimates.back() / truths.back()));
    abs_ln.push_back(std::abs(ln_ratio.back()));
    const auto low = estimate.mor_low_m(), high = estimate.mor_high_m();
    if (!low || !high) continue;
    ++scores.bounded;
    covered += *low <= truths.back() && truths.back() <= *high;
  }
  scores.coverage = share(covered, scores.bounded);
  scores.median_abs_ln = percentile(abs_ln, 0.5);
  scores.p95_abs_ln = percentile(abs_ln, 0.95);
  if (!ln_ratio.empty())
    scores.bias_ln =
        std::accumulate(ln_ratio.begin(), ln_ratio.end(), 0.0) / static_cast<double>(ln_ratio.size());
  scores.spearman = spearman(estimates, truths);
}

std::string percent(const std::optional<double>& value) {
  return value ? fmt::format("{:.1f} %", 100 * *value) : "unknown";
}

std::string three(const std::optional<double>& value) {
  return value ? fmt::format("{:.3f}", *value) : "unknown";
}

std::string format_weather(const Scores& scores) {
  if (scores.weather_pairs == 0) return "";
  std::string text = fmt::format("Weather class, truth down, estimate across ({} right):\n{:>10}",
                                 percent(scores.weather_right_share), "");
  for (int i = 0; i < 6; ++i) text += fmt::format("{:>8}", to_string(static_cast<Weather>(i)));
  for (std::size_t i = 0; i < 6; ++i) {
    if (std::accumulate(scores.weather[i].begin(), scores.weather[i].end(), std::size_t{0}) == 0) continue;
    text += fmt::format("\n{:>10}", to_string(static_cast<Weather>(i)));
    for (const std::size_t count : scores.weather[i]) text += fmt::format("{:>8}", count);
  }
  return text + "\n";
}

}  // namespace

std::vector<ScoredPair> match_truth(const std::vector<Observation>& observations,
                                    const std::vector<Truth>& truths) {
  std::map<TimePoint, const Truth*> by_time;
  for (const Truth& truth : truths)
    if (truth.mor_m) by_time[truth.time_utc] = &truth;
  std::vector<ScoredPair> pairs;
  for (const Observation& observation : observations)
    if (const auto found = by_time.find(observation.time_utc); found != by_time.end())
      pairs.push_back({observation, *found->second});
  return pairs;
}

double wmo_allowed_error_m(double true_mor_m) {
  if (true_mor_m <= 600) return 50;
  return true_mor_m * (true_mor_m <= 1500 ? 0.10 : 0.20);
}

std::optional<double> percentile(std::vector<double> values, double share) {
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return std::lerp(values[below], values[above], at - static_cast<double>(below));
}

std::optional<double> spearman(const std::vector<double>& a, const std::vector<double>& b) {
  if (a.size() < 3) return std::nullopt;
  const std::vector<double> rank_a = ranks(a), rank_b = ranks(b);
  const double mean = (static_cast<double>(a.size()) + 1) / 2;
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += (rank_a[i] - mean) * (rank_b[i] - mean);
    aa += (rank_a[i] - mean) * (rank_a[i] - mean);
    bb += (rank_b[i] - mean) * (rank_b[i] - mean);
  }
  if (aa == 0 || bb == 0) return std::nullopt;
  return ab / std::sqrt(aa * bb);
}

Scores score(const std::vector<ScoredPair>& pairs) {
  Scores scores;
  scores.pairs = pairs.size();
  for (const ScoredPair& pair : pairs) {
    count_kind(pair, scores);
    count_fog(pair, scores);
    count_weather(pair, scores);
  }
  scores.within_wmo_share = share(scores.within_wmo, scores.values);
  scores.within_wmo_share_of_all = share(scores.within_wmo, scores.pairs);
  score_values(pairs, scores);
  scores.fog_right_share = share(scores.fog[0][0] + scores.fog[1][1], scores.pairs - scores.fog_undecided);
  std::size_t weather_right = 0;
  for (std::size_t i = 0; i < 6; ++i) weather_right += scores.weather[i][i];
  scores.weather_right_share = share(weather_right, scores.weather_pairs);
  return scores;
}

std::vector<RangeScores> score_by_range(const std::vector<ScoredPair>& pairs) {
  std::vector<RangeScores> ranges;
  constexpr std::array kEdges_m{0.0, 600.0, 1500.0, 5000.0, 1e9};
  for (std::size_t i = 0; i + 1 < kEdges_m.size(); ++i) {
    std::vector<ScoredPair> inside;
    for (const ScoredPair& pair : pairs)
      if (*pair.truth.mor_m >= kEdges_m[i] && *pair.truth.mor_m < kEdges_m[i + 1]) inside.push_back(pair);
    ranges.push_back({kEdges_m[i], kEdges_m[i + 1], score(inside)});
  }
  return ranges;
}

std::string format_scores(const Scores& s, const std::vector<RangeScores>& ranges) {
  std::string text = fmt::format("{} records have a truth: {} values, {} limits, {} without either\n",
                                 s.pairs, s.values, s.limits, s.none);
  text +=
      fmt::format("Values within the WMO limits:  {} ({} of {}); of all records {}\n",
                  percent(s.within_wmo_share), s.within_wmo, s.values, percent(s.within_wmo_share_of_all));
  text += fmt::format("Limits that the truth keeps:   {} of {}\n", s.limits_right, s.limits);
  text += fmt::format("|ln(estimate/truth)|:          median {}, 95th percentile {}\n",
                      three(s.median_abs_ln), three(s.p95_abs_ln));
  text += fmt::format("Bias, mean ln(estimate/truth): {}\n", three(s.bias_ln));
  text += fmt::format("Truth within the 95 % bounds:  {} of {} values\n", percent(s.coverage), s.bounded);
  text += fmt::format("Spearman's rank correlation:   {}\n", three(s.spearman));
  text += fmt::format(
      "Fog (MOR < 1000 m):            {} right; hits {}, misses {}, false alarms {}, rightly none {}, "
      "undecided {}\n",
      percent(s.fog_right_share), s.fog[1][1], s.fog[1][0], s.fog[0][1], s.fog[0][0], s.fog_undecided);
  text += "By true MOR:\n";
  for (const RangeScores& range : ranges) {
    if (range.scores.pairs == 0) continue;
    const std::string name = range.high_m > 1e8
                                 ? fmt::format("{:.0f} m and more", range.low_m)
                                 : fmt::format("{:.0f} to {:.0f} m", range.low_m, range.high_m);
    text += fmt::format("  {:<16} {:3} records, {:3} values, {:3} within WMO, {:3} limits ({} right)\n", name,
                        range.scores.pairs, range.scores.values, range.scores.within_wmo, range.scores.limits,
                        range.scores.limits_right);
  }
  return text + format_weather(s);
}

}  // namespace lampglow::daemon
