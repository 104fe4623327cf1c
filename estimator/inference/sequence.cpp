#include "estimator/inference/sequence.h"

#include <algorithm>
#include <cmath>

#include "estimator/inference/weather.h"

namespace lampglow::inference {
namespace {

double seconds_between(TimePoint earlier, TimePoint later) {
  return std::chrono::duration<double>(later - earlier).count();
}

// One standard deviation of σ from its 95 % bounds, in ln σ; a usual 10 % where there are none.
double sigma_of(const Observation& o) {
  const double value = *o.extinction_per_m;
  if (!o.extinction_low_per_m || !o.extinction_high_per_m || *o.extinction_low_per_m <= 0) return 0.1 * value;
  return value * std::log(*o.extinction_high_per_m / *o.extinction_low_per_m) / (2 * 1.96);
}

bool is_mist_or_haze(Weather weather) {
  return weather == Weather::mist || weather == Weather::haze;
}

}  // namespace

Weather Sequence::with_hysteresis(const Observation& o) const {
  if (past_.empty() || !o.extinction_per_m || o.limit == Limit::below) return o.weather;
  if (seconds_between(past_.back().time_utc, o.time_utc) > options_.hold_s) return o.weather;
  const Weather before = past_.back().weather;
  const double mor = kMorTimesExtinction / *o.extinction_per_m;
  if (before == Weather::fog && o.weather != Weather::rain && mor < options_.fog_mor_m * options_.clear_again)
    return Weather::fog;
  if (is_mist_or_haze(before) && o.weather == Weather::clear &&
      mor < options_.mist_mor_m * options_.clear_again)
    return before;
  return o.weather;
}

// Mean σ of the observations between two ages; empty with fewer than `least`.
std::optional<double> Sequence::mean_between(double from_s_ago, double to_s_ago, int least) const {
  double sum = 0;
  int count = 0;
  for (const Observation& o : past_) {
    const double age = seconds_between(o.time_utc, past_.back().time_utc);
    if (!o.extinction_per_m || age > from_s_ago || age < to_s_ago) continue;
    sum += *o.extinction_per_m;
    ++count;
  }
  if (count < least) return std::nullopt;
  return sum / count;
}

// 30 fog, 32 thinning, 33 steady, 34 thickening, 31 patches (fog came and went within the hour), 20 fog in
// the past hour.
std::optional<int> Sequence::present_weather(const Observation& o) const {
  if (!o.extinction_per_m) return std::nullopt;
  const double mor = kMorTimesExtinction / *o.extinction_per_m;
  int fogs = 0, changes = 0;
  for (size_t i = 0; i < past_.size(); ++i) {
    fogs += past_[i].weather == Weather::fog;
    changes += i > 0 && (past_[i].weather == Weather::fog) != (past_[i - 1].weather == Weather::fog);
  }
  if (o.weather != Weather::fog) {
    if (fogs > 0 && o.weather != Weather::unknown && o.weather != Weather::rain) return 20;
    return wmo_4680_now(o.weather, mor);
  }
  if (changes >= 2) return 31;
  const auto first = mean_between(options_.history_s, options_.history_s - options_.trend_window_s, 2);
  const auto last = mean_between(options_.trend_window_s, 0, 2);
  if (!first || !last) return 30;
  const double change = *first / *last - 1;  // of MOR
  if (change > options_.trend_change) return 32;
  return change < -options_.trend_change / (1 + options_.trend_change) ? 34 : 33;
}

Observation Sequence::add(Observation observation) {
  if (!past_.empty() && observation.time_utc <= past_.back().time_utc) return observation;
  observation.weather = with_hysteresis(observation);
  past_.push_back(observation);
  while (seconds_between(past_.front().time_utc, observation.time_utc) > options_.history_s)
    past_.pop_front();
  past_.back().wmo_4680 = observation.wmo_4680 = present_weather(observation);
  return observation;
}

std::optional<ExtinctionMean> Sequence::mean(double period_s) const {
  ExtinctionMean mean;
  double own = 0, shared = 0;
  bool above = false, below = false;
  for (const Observation& o : past_) {
    if (!o.extinction_per_m || seconds_between(o.time_utc, past_.back().time_utc) >= period_s) continue;
    const double sigma = sigma_of(o);
    mean.extinction_per_m += *o.extinction_per_m;
    own += sigma * sigma * (1 - options_.shared_error);
    shared += sigma * std::sqrt(options_.shared_error);
    above = above || o.limit == Limit::above;
    below = below || o.limit == Limit::below;
    ++mean.count;
  }
  if (mean.count == 0 || (above && below)) return std::nullopt;
  mean.limit = above ? Limit::above : below ? Limit::below : Limit::none;
  mean.extinction_per_m /= mean.count;
  mean.sigma_per_m = std::sqrt(own + shared * shared) / mean.count;
  return mean;
}

}  // namespace lampglow::inference
