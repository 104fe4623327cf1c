#include "estimator/scattering/medium.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "estimator/scattering/attenuation.h"

namespace lampglow::scattering {
namespace {

TEST(Medium, SplitsExtinctionIntoScatteringAndAbsorption) {
  const Medium fog{0.02, 0.9, 0.85};
  EXPECT_DOUBLE_EQ(fog.scattering_per_m(), 0.018);
  EXPECT_NEAR(fog.absorption_per_m(), 0.002, 1e-15);
  EXPECT_DOUBLE_EQ(fog.transport_per_m(), 0.02 * (1 - 0.9 * 0.85));
  EXPECT_DOUBLE_EQ(optical_thickness(0.02, 150), 3);
}

TEST(Medium, RefusesWhatCannotBe) {
  EXPECT_NO_THROW(check(Medium{0.01, 1, 0.9}));
  EXPECT_THROW(check(Medium{0, 1, 0.9}), std::invalid_argument);
  EXPECT_THROW(check(Medium{0.01, 1.01, 0.9}), std::invalid_argument);
  EXPECT_THROW(check(Medium{0.01, 1, 1}), std::invalid_argument);
  EXPECT_THROW(check(Medium{NAN, 1, 0}), std::invalid_argument);
}

TEST(Visibility, IsWhereContrastFallsToTwoAndFivePercent) {
  const double extinction = 0.003;
  EXPECT_NEAR(visibility_two_percent_m(extinction), 3.912 / extinction, 0.01);
  EXPECT_NEAR(meteorological_optical_range_m(extinction), 2.996 / extinction, 0.1);
  EXPECT_NEAR(bouguer_transmission(extinction * visibility_two_percent_m(extinction)), 0.02, 1e-12);
  EXPECT_NEAR(extinction_from_mor_per_m(meteorological_optical_range_m(extinction)), extinction, 1e-15);
  // A black object at the MOR has 5 % contrast to the horizon.
  EXPECT_NEAR(apparent_contrast(0, 1, meteorological_optical_range_m(extinction), extinction), -0.05, 1e-12);
}

TEST(Attenuation, CombinesBouguerAndKoschmieder) {
  EXPECT_NEAR(bouguer_irradiance(100, 50, 0.02), 100 * std::exp(-1) / 2500, 1e-15);
  EXPECT_NEAR(attenuation_with_airlight(3, 10, 100, 0.01), 3 * std::exp(-1) + 10 * (1 - std::exp(-1)), 1e-12);
  EXPECT_DOUBLE_EQ(attenuation_with_airlight(7, 7, 123, 0.02), 7);  // what is as bright as the sky stays so
  EXPECT_NEAR(koschmieder_airlight(1, 1, 1e-12), 1e-12, 1e-24);     // no cancellation in clear air
}

}  // namespace
}  // namespace lampglow::scattering
