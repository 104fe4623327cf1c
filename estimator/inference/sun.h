// Where the sun stands: decides day, twilight and night, and which way shadows fall.
#pragma once

#include "estimator/time.h"

namespace lampglow::inference {

struct SunPosition {
  double altitude_deg = 0;  // of the sun's centre above the horizon, refraction included; -90..90
  double azimuth_deg = 0;   // from north over east, 0..360
};

// J. Meeus, Astronomical Algorithms (2nd ed. 1998), chapter 25, low accuracy, as NOAA's solar calculator has
// it: good to about 0.01 deg for 1950-2050, apart from refraction at the horizon (0.1 deg with the weather).
// latitude north positive, longitude east positive, both in degrees.
SunPosition sun_position(TimePoint time_utc, double latitude_deg, double longitude_deg);

}  // namespace lampglow::inference
