// How observers write visibility down.
#pragma once

#include <optional>
#include <string>

#include "estimator/observation.h"

namespace lampglow::web {

// METAR's four digits: rounded down to 50 m below 800 m, 100 m below 5000 m, 1000 m below 10 km, then 9999;
// below 50 m 0000 (ICAO Annex 3). "////" where there is no value, or only a bound that does not reach 10 km.
std::string metar_visibility(const Observation& observation);

// FG below 1000 m, BR from 1000 to 5000 m, HZ up to 5000 m where the particles are dry (class haze); RA for
// rain. Empty: nothing to report, or not known.
std::string metar_weather(const Observation& observation);

// "METAR HARBOUR 220100Z AUTO /////KT 0250 FG": METAR-like; wind, clouds, temperature and pressure are
// unknown.
std::string metar_like(const std::string& station, const Observation& observation);

}  // namespace lampglow::web
