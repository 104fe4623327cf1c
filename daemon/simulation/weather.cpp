#include "daemon/simulation/weather.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lampglow::simulation {

namespace {

struct WeatherClass {
  Weather weather;
  int different_q;               // how many q a night uses
  double mor_low_m, mor_high_m;  // what this weather's visibility can be (METAR's FG, BR and HZ limits)
  double q_low, q_high;          // the lecture's range
  double share;                  // of the night
};

constexpr WeatherClass kClasses[] = {
    {Weather::clear, 2, 6000, 25000, 0.40, 0.68, 0.16}, {Weather::haze, 3, 1200, 4950, 0.71, 0.79, 0.15},
    {Weather::mist, 3, 1030, 4950, 0.805, 0.845, 0.18}, {Weather::fog, 4, 40, 970, 0.855, 0.895, 0.36},
    {Weather::rain, 2, 1100, 8000, 0.915, 0.96, 0.15},
};

// The q of one class in this night, evenly spread with a random offset, so that no two nights share them.
double draw_q(const WeatherClass& kind, double offset, int which) {
  return kind.q_low + (kind.q_high - kind.q_low) * (which + offset) / kind.different_q;
}

// ln MOR wanders within [low, high]: a slow wave over the whole range and a random walk on it. In fog the
// wave starts and ends thin and is thickest in the middle.
std::vector<double> draw_mor(int count, double low_m, double high_m, bool fog, Random& random) {
  std::vector<double> mor;
  const double range = std::log(high_m / low_m);
  const double phase = random.uniform(0, 6.28);
  double walk = 0;
  for (int i = 0; i < count; ++i) {
    const double x = (i + 0.5) / count;
    const double wave = fog ? std::pow(std::abs(2 * x - 1), 0.8) : 0.5 + 0.45 * std::sin(phase + 5 * x);
    walk = 0.6 * walk + 0.08 * random.normal();
    mor.push_back(low_m * std::exp(range * std::clamp(wave + (fog ? 0.6 : 1) * walk, 0.0, 1.0)));
  }
  return mor;
}

// How many of the night's samples each class gets: its share, largest remainders first, so that they sum to
// count.
std::vector<int> divide_night(int count, const std::vector<const WeatherClass*>& classes) {
  double total = 0;
  for (const WeatherClass* kind : classes) total += kind->share;
  std::vector<int> samples;
  samples.reserve(classes.size());
  for (const WeatherClass* kind : classes) samples.push_back(static_cast<int>(count * kind->share / total));
  int left = count - std::accumulate(samples.begin(), samples.end(), 0);
  for (size_t i = classes.size(); left > 0; --left) samples[i = (i + samples.size() - 1) % samples.size()]++;
  return samples;
}

}  // namespace

std::vector<Air> draw_weather(int count, double mor_min_m, double mor_max_m, Random& random) {
  std::vector<const WeatherClass*> classes;
  for (const WeatherClass& kind : kClasses) {
    if (kind.mor_high_m > mor_min_m && kind.mor_low_m < mor_max_m) classes.push_back(&kind);
  }
  for (size_t i = classes.size(); i > 1; --i) {
    std::swap(classes[i - 1], classes[static_cast<size_t>(random.below(static_cast<int>(i)))]);
  }
  const std::vector<int> samples = divide_night(count, classes);
  std::vector<Air> night;
  for (size_t c = 0; c < classes.size(); ++c) {
    const WeatherClass& kind = *classes[c];
    const double offset = random.uniform();
    const std::vector<double> mor =
        draw_mor(samples[c], std::max(kind.mor_low_m, mor_min_m), std::min(kind.mor_high_m, mor_max_m),
                 kind.weather == Weather::fog, random);
    for (int i = 0; i < samples[c]; ++i) {
      const int which = i * kind.different_q / samples[c];
      night.push_back({kind.weather, mor[static_cast<size_t>(i)], draw_q(kind, offset, which)});
    }
  }
  return night;
}

}  // namespace lampglow::simulation
