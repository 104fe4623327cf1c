// How good the estimates are against a sensor's truth. All of it is pure: pairs in, numbers out.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "daemon/sources/truth.h"
#include "estimator/observation.h"

namespace lampglow::daemon {

// One observation and the truth of the same time.
struct ScoredPair {
  Observation estimate;
  Truth truth;
};

// Pairs by equal time_utc; observations without a truth value of their time are left out.
std::vector<ScoredPair> match_truth(const std::vector<Observation>& observations,
                                    const std::vector<Truth>& truths);

// Required uncertainty of MOR (WMO-No. 8, ICAO Annex 3): ±50 m up to 600 m, ±10 % up to 1500 m, ±20 % above.
double wmo_allowed_error_m(double true_mor_m);

// A limit is not a value: it counts under limits_*, never under the scores of values. `above` L is right
// where the truth is at least L, `below` L where it is at most L; L is the 95 % bound, so 1 in 20 may be
// wrong.
struct Scores {
  std::size_t pairs = 0;   // records that have a truth
  std::size_t values = 0;  // of them with a value
  std::size_t limits = 0;
  std::size_t none = 0;

  std::size_t within_wmo = 0;                     // values within the WMO limits
  std::size_t limits_right = 0;                   // limits that the truth keeps
  std::optional<double> within_wmo_share;         // within_wmo / values
  std::optional<double> within_wmo_share_of_all;  // within_wmo / pairs: limits and gaps count as misses
  std::optional<double> median_abs_ln;            // of |ln(estimate / truth)| over values
  std::optional<double> p95_abs_ln;               // 95th percentile, interpolated between ranks
  std::optional<double> bias_ln;                  // mean of ln(estimate / truth); > 0: too clear
  std::optional<double> coverage;                 // share of bounded values with low <= truth <= high
  std::size_t bounded = 0;                        // values with both bounds
  std::optional<double> spearman;                 // rank correlation of values and truth, ties averaged

  // Fog is MOR below 1000 m. [true fog][estimated fog]; a limit counts where it decides.
  std::array<std::array<std::size_t, 2>, 2> fog{};
  std::size_t fog_undecided = 0;
  std::optional<double> fog_right_share;  // of the decided

  // [true class][estimated class] by Weather's numbers; pairs whose truth has no class are left out.
  std::array<std::array<std::size_t, 6>, 6> weather{};
  std::size_t weather_pairs = 0;
  std::optional<double> weather_right_share;
};

Scores score(const std::vector<ScoredPair>& pairs);

// The scores of the pairs whose truth lies in one range, as the field asks for them.
struct RangeScores {
  double low_m = 0, high_m = 0;  // low <= truth < high
  Scores scores;
};
std::vector<RangeScores> score_by_range(const std::vector<ScoredPair>& pairs);

// For people, several lines.
std::string format_scores(const Scores& scores, const std::vector<RangeScores>& ranges);

// Building blocks, for the tests.
std::optional<double> percentile(std::vector<double> values, double share);
std::optional<double> spearman(const std::vector<double>& a, const std::vector<double>& b);

}  // namespace lampglow::daemon
