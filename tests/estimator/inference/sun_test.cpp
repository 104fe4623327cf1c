#include "estimator/inference/sun.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lampglow::inference {
namespace {

SunPosition at(const char* time_utc, double latitude_deg, double longitude_deg) {
  return sun_position(parse_time_utc(time_utc).value(), latitude_deg, longitude_deg);
}

// The worked example of Reda and Andreas, NREL/TP-560-34302 (2008), table A5.1: zenith 50.11162 deg, azimuth
// 194.34024 deg (820 hPa).
TEST(SunPosition, AgreesWithTheSolarPositionAlgorithmsWorkedExample) {
  const SunPosition sun = at("2003-10-17T19:30:30Z", 39.742476, -105.1786);
  EXPECT_NEAR(sun.altitude_deg, 90.0 - 50.11162, 0.02);
  EXPECT_NEAR(sun.azimuth_deg, 194.34024, 0.02);
}

// Meeus, example 25.a: 1992-10-13 0h TD, declination -7.78507 deg. At the south pole the altitude is minus
// the declination whatever the hour.
TEST(SunPosition, AtThePoleTheAltitudeIsTheDeclination) {
  EXPECT_NEAR(at("1992-10-13T00:00:00Z", -90.0, 0.0).altitude_deg, 7.785 + 0.112,
              0.01);  // refraction at 7.8 deg
  EXPECT_NEAR(at("1992-10-13T00:00:00Z", 90.0, 77.0).altitude_deg, -7.785, 0.01);
}

TEST(SunPosition, RisesInTheEastAndSetsInTheWest) {
  EXPECT_NEAR(at("2015-03-20T06:07:00Z", 0.0, 0.0).azimuth_deg, 90.0, 0.3);
  EXPECT_NEAR(at("2015-03-20T18:07:00Z", 0.0, 0.0).azimuth_deg, 270.0, 0.3);
  EXPECT_LT(at("2015-03-20T05:50:00Z", 0.0, 0.0).altitude_deg, -3.0);
  EXPECT_GT(at("2015-03-20T06:30:00Z", 0.0, 0.0).altitude_deg, 5.0);
}

// De Bilt on the day of the test archive: the almanac has sunrise 05:50 and sunset 17:00 UTC (upper limb at
// the refracted horizon: the centre stands at -0.27 deg).
TEST(SunPosition, SunriseAndSunsetAtDeBilt) {
  EXPECT_NEAR(at("2015-10-09T05:51:00Z", 52.1093, 5.1810).altitude_deg, -0.27, 0.35);
  EXPECT_NEAR(at("2015-10-09T17:00:00Z", 52.1093, 5.1810).altitude_deg, -0.27, 0.35);
  const SunPosition noon = at("2015-10-09T11:26:30Z", 52.1093, 5.1810);
  EXPECT_NEAR(noon.azimuth_deg, 180.0, 0.3);
  EXPECT_NEAR(noon.altitude_deg, 90.0 - 52.1093 - 6.30, 0.1);
}

TEST(SunPosition, AltitudeHasNoStepWhereRefractionFadesOut) {
  double last = at("2015-10-09T17:00:00Z", 52.1093, 5.1810).altitude_deg;
  for (int second = 1; second < 1200; ++second) {
    const TimePoint t = parse_time_utc("2015-10-09T17:00:00Z").value() + std::chrono::seconds(second);
    const double now = sun_position(t, 52.1093, 5.1810).altitude_deg;
    EXPECT_LT(std::abs(now - last), 0.01) << second;
    last = now;
  }
}

}  // namespace
}  // namespace lampglow::inference
