#include "estimator/inference/weather.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lampglow::inference {
namespace {

double normal_below(double x) {
  return 0.5 * std::erfc(-x / std::numbers::sqrt2);
}

// Probability that a normal quantity lies in [low, high], spread over the interval's width: an evidence for a
// class whose members are even over it.
double evidence(double mean, double sd, double low, double high) {
  return (normal_below((high - mean) / sd) - normal_below((low - mean) / sd)) / (high - low);
}

struct ClassRange {
  Weather weather;
  double mor_low_m, mor_high_m, q_low, q_high;
};

constexpr ClassRange kRanges[] = {
    {Weather::clear, 5000, 80000, 0.0, 0.70}, {Weather::haze, 700, 5000, 0.70, 0.80},
    {Weather::mist, 1000, 5000, 0.80, 0.85},  {Weather::fog, 20, 1000, 0.84, 0.91},
    {Weather::rain, 500, 10000, 0.90, 0.99},
};

// Of even lamps, and of such as send their light down: either may be before us.
double evidence_of_q(const AirEstimate& air, const ClassRange& range) {
  const double sd = std::hypot(air.q_sd.value_or(0.1), 0.01), excess = air.q_excess_of_luminaires;
  const double even = evidence(*air.q, sd, range.q_low, range.q_high);
  if (excess <= 0) return even;
  constexpr double kSentDown = 0.25;  // how likely that is: halves would call mist of even lamps haze
  return std::lerp(even, evidence(*air.q - excess, std::hypot(sd, excess / 2), range.q_low, range.q_high),
                   kSentDown);
}

double humidity_factor(Weather weather, double humidity) {
  const double wet = 1.0 / (1.0 + std::exp(-(humidity - 0.88) / 0.03));
  switch (weather) {
    case Weather::haze:
      return 1.0 - 0.98 * wet;
    case Weather::mist:
    case Weather::fog:
      return 0.02 + 0.98 * wet;
    default:
      return 0.5;
  }
}

}  // namespace

Weather lecture_class(double q) {
  if (q < 0.7) return Weather::clear;
  if (q < 0.8) return Weather::haze;
  if (q < 0.85) return Weather::mist;
  return q < 0.9 ? Weather::fog : Weather::rain;
}

std::array<double, 6> weather_probabilities(const AirEstimate& air) {
  std::array<double, 6> p{};
  const double ln_mor = std::log(kMorTimesExtinction) - air.ln_sigma;
  double sum = 0;
  for (const ClassRange& range : kRanges) {
    // 3 % of leeway in MOR: what people call fog does not end at the metre.
    double high = std::log(range.mor_high_m), low = std::log(range.mor_low_m);
    if (range.weather == Weather::clear && air.limit == Limit::above) high = std::max(high, ln_mor + 1);
    if (range.weather == Weather::fog && air.limit == Limit::below) low = std::min(low, ln_mor - 1);
    double value = evidence(ln_mor, std::hypot(air.ln_sigma_sd, 0.02), low, high);
    if (air.q) value *= evidence_of_q(air, range);
    if (air.relative_humidity) value *= humidity_factor(range.weather, *air.relative_humidity);
    p[static_cast<size_t>(range.weather)] = value;
    sum += value;
  }
  if (sum <= 0) {
    // No class fits its q: extinction decides.
    const double mor = std::exp(ln_mor);
    p = {};
    p[static_cast<size_t>(mor < 1000 ? Weather::fog : mor < 5000 ? Weather::mist : Weather::clear)] = 1;
    return p;
  }
  for (double& value : p) value /= sum;
  return p;
}

Weather decide_weather(const std::array<double, 6>& probability, double sure) {
  const auto best = std::max_element(probability.begin(), probability.end());
  if (*best < sure) return Weather::unknown;
  return static_cast<Weather>(best - probability.begin());
}

std::optional<int> wmo_4680_now(Weather weather, double mor_m) {
  switch (weather) {
    case Weather::clear:
      return 0;
    case Weather::haze:
      return mor_m >= 1000 ? 4 : 5;
    case Weather::mist:
      return 10;
    case Weather::fog:
      return 30;
    case Weather::rain:
      return 60;
    case Weather::unknown:
      break;
  }
  return std::nullopt;
}

}  // namespace lampglow::inference
