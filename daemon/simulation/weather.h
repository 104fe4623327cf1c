// A night's weather: episodes of clear air, haze, mist, fog and rain, each with the q of its class (the
// lecture's classes, after van de Hulst 1957) and a visibility that fits it.
#pragma once

#include <vector>

#include "daemon/simulation/random.h"
#include "estimator/observation.h"

namespace lampglow::simulation {

struct Air {
  Weather weather = Weather::clear;
  double mor_m = 0;
  double q = 0;
};

// `count` samples through the night, with MOR kept within [mor_min_m, mor_max_m]. Every class that this range
// allows has its episode; fog comes down to mor_min_m. There are at most 14 different q in a night.
std::vector<Air> draw_weather(int count, double mor_min_m, double mor_max_m, Random& random);

}  // namespace lampglow::simulation
