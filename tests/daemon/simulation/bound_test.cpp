#include "daemon/simulation/bound.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lampglow::simulation {
namespace {

constexpr double kExposures_s[] = {0.008, 0.125, 2.0};

// A night of one frame of fog or of clear air, with nothing wrong in it.
Night quiet_night(std::vector<double> distances_m, double mor_m, double q) {
  NightOptions options{.seed = 1, .frames = 1, .distances_m = std::move(distances_m)};
  options.nuisances = {false, false, false, false, false, false, false, false};
  Night night = plan_night(options);
  night.frames.back().extinction_per_m = kMorTimesExtinction / mor_m;
  night.frames.back().q = q;
  return night;
}

const HaloLibrary& halos() {
  static const HaloLibrary library({{0.80, 12}, {0.86, 12}}, 200000, 1, 2, [](int, int) {});
  return library;
}

double bound(const Night& night, const Sensor& sensor = bracket_sensor()) {
  return bound_of_ln_extinction(night, night.frames.back(), halos(), sensor, kExposures_s).value();
}

// Two lamps without halos give σ by the ratio of their beams alone: δσ = 6 % √2 / (R2 - R1). With halos it
// must be known at least as well; in very clear air, where these carry little, not much better than by the
// lamps' priors.
TEST(Bound, IsNoWorseThanTwoBeamsAlone) {
  const double mor_m = 20000;
  const Night night = quiet_night({100, 1100}, mor_m, 0.80);
  const double beams = 0.06 * std::sqrt(2.0) / 1000 / (kMorTimesExtinction / mor_m);
  EXPECT_LT(bound(night), beams * 1.01);
  EXPECT_GT(bound(night), beams * 0.05);
}

TEST(Bound, MoreLampsAndMoreLightKnowMore) {
  const Night one = quiet_night({200}, 600, 0.86);
  const Night three = quiet_night({100, 200, 400}, 600, 0.86);
  EXPECT_LT(bound(three), bound(one));
  Sensor noisy = bracket_sensor();
  noisy.read_noise_dn = 80;
  EXPECT_GT(bound(one, noisy), bound(one));
}

TEST(Bound, IsEmptyWhereNoLampBurns) {
  Night night = quiet_night({200}, 600, 0.86);
  night.frames.back().lamp_strength = {0};
  EXPECT_FALSE(bound_of_ln_extinction(night, night.frames.back(), halos(), bracket_sensor(), kExposures_s));
}

}  // namespace
}  // namespace lampglow::simulation
