#include "estimator/inference/sun.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace lampglow::inference {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

double sin_deg(double angle_deg) {
  return std::sin(angle_deg * kRadPerDeg);
}
double cos_deg(double angle_deg) {
  return std::cos(angle_deg * kRadPerDeg);
}
double wrap_deg(double angle_deg) {
  return angle_deg - 360.0 * std::floor(angle_deg / 360.0);
}

struct Equatorial {
  double right_ascension_deg = 0;
  double declination_deg = 0;
};

// Meeus (25.2)-(25.8): apparent place, t in Julian centuries since 2000-01-01 12:00 TT. UTC is taken for TT:
// a minute's motion of the sun is 0.0007 deg.
Equatorial apparent_sun(double t) {
  const double mean_longitude_deg = 280.46646 + t * (36000.76983 + t * 0.0003032);
  const double mean_anomaly_deg = 357.52911 + t * (35999.05029 - t * 0.0001537);
  const double centre_deg = (1.914602 - t * (0.004817 + t * 0.000014)) * sin_deg(mean_anomaly_deg) +
                            (0.019993 - t * 0.000101) * sin_deg(2.0 * mean_anomaly_deg) +
                            0.000289 * sin_deg(3.0 * mean_anomaly_deg);
  const double node_deg = 125.04 - 1934.136 * t;
  const double longitude_deg = mean_longitude_deg + centre_deg - 0.00569 - 0.00478 * sin_deg(node_deg);
  const double obliquity_deg = 23.4392911 - t * 0.0130042 + 0.00256 * cos_deg(node_deg);
  return {wrap_deg(std::atan2(cos_deg(obliquity_deg) * sin_deg(longitude_deg), cos_deg(longitude_deg)) /
                   kRadPerDeg),
          std::asin(sin_deg(obliquity_deg) * sin_deg(longitude_deg)) / kRadPerDeg};
}

// Meeus (12.4) without nutation: 0.005 deg at most.
double greenwich_sidereal_deg(double days_since_2000) {
  return wrap_deg(280.46061837 + 360.98564736629 * days_since_2000);
}

// Saemundsson's formula (Meeus 16.4) for 1010 hPa and 10 C; below -1 deg it fades out, for there is no ray.
double refraction_deg(double altitude_deg) {
  const double h = std::max(altitude_deg, -1.0);
  const double at_h = 1.02 / 60.0 / std::tan((h + 10.3 / (h + 5.11)) * kRadPerDeg);
  return altitude_deg < -1.0 ? at_h * std::exp(altitude_deg + 1.0) : std::max(at_h, 0.0);
}

}  // namespace

SunPosition sun_position(TimePoint time_utc, double latitude_deg, double longitude_deg) {
  using namespace std::chrono;
  constexpr TimePoint kEpoch2000 = sys_days{year{2000} / January / 1} + hours{12};
  const double days_since_2000 = duration<double, std::ratio<86400>>(time_utc - kEpoch2000).count();
  const Equatorial sun = apparent_sun(days_since_2000 / 36525.0);
  const double hour_angle_deg =
      greenwich_sidereal_deg(days_since_2000) + longitude_deg - sun.right_ascension_deg;

  // East, north and up components of the direction to the sun.
  const double east = -cos_deg(sun.declination_deg) * sin_deg(hour_angle_deg);
  const double north = sin_deg(sun.declination_deg) * cos_deg(latitude_deg) -
                       cos_deg(sun.declination_deg) * cos_deg(hour_angle_deg) * sin_deg(latitude_deg);
  const double up = sin_deg(sun.declination_deg) * sin_deg(latitude_deg) +
                    cos_deg(sun.declination_deg) * cos_deg(hour_angle_deg) * cos_deg(latitude_deg);
  const double altitude_deg = std::asin(std::clamp(up, -1.0, 1.0)) / kRadPerDeg;
  return {altitude_deg + refraction_deg(altitude_deg), wrap_deg(std::atan2(east, north) / kRadPerDeg)};
}

}  // namespace lampglow::inference
