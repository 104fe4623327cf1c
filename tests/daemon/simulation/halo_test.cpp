#include "daemon/simulation/halo.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace lampglow::simulation {
namespace {

double ln_rad(double degrees) {
  return std::log(degrees * std::numbers::pi / 180);
}

// The table of physics.md: per unit flux in optical units; it agreed with Blender Cycles within noise.
struct Row {
  double q, thickness;
  double radiance[8];
};
constexpr double kDegrees[] = {0.2, 0.5, 1, 2, 5, 10, 20, 40};
constexpr Row kTable[] = {
    {0.75, 0.5, {18.0, 7.26, 3.59, 1.73, 0.605, 0.225, 0.0643, 0.0150}},
    {0.75, 1.5, {2.32, 0.957, 0.496, 0.259, 0.105, 0.0461, 0.0166, 0.00509}},
    {0.75, 4, {0.0821, 0.0396, 0.0243, 0.0160, 0.00950, 0.00610, 0.00350, 0.00173}},
    {0.9, 0.5, {43.7, 17.1, 8.10, 3.52, 0.828, 0.188, 0.0326, 0.00549}},
    {0.9, 1.5, {5.78, 2.40, 1.23, 0.590, 0.172, 0.0481, 0.0101, 0.00191}},
    {0.9, 4, {0.226, 0.115, 0.0723, 0.0457, 0.0213, 0.00909, 0.00289, 0.000747}},
};

TEST(Halo, IsThePublishedOne) {
  const HaloLibrary halos({{0.75, 6}, {0.9, 6}}, 400000, 1, 2, [](int, int) {});
  for (const Row& row : kTable) {
    const HaloProfile halo = halos.profile(row.q, row.thickness);
    const double scale = 4 * std::numbers::pi * row.thickness * row.thickness;
    double squares = 0;
    for (size_t i = 0; i < std::size(kDegrees); ++i) {
      const double ratio = halo.radiance(ln_rad(kDegrees[i])) / scale / row.radiance[i];
      EXPECT_NEAR(ratio, 1, 0.15) << "q " << row.q << " T " << row.thickness << " at " << kDegrees[i];
      squares += std::pow(std::log(ratio), 2);
    }
    EXPECT_LT(std::sqrt(squares / std::size(kDegrees)), 0.05) << "q " << row.q << " T " << row.thickness;
  }
}

TEST(Halo, ThinAirGivesALittleOfItAndVeryThickNone) {
  const HaloLibrary halos({{0.8, 12}}, 100000, 1, 1, [](int, int) {});
  const double thin = halos.profile(0.8, 0.001).radiance(ln_rad(1));
  const double twice = halos.profile(0.8, 0.002).radiance(ln_rad(1));
  EXPECT_NEAR(twice / thin, 2, 0.01);
  EXPECT_TRUE(halos.profile(0.8, 30).dark());
  EXPECT_EQ(halos.profile(0.8, 30).radiance(ln_rad(1)), 0);
}

TEST(Halo, ThreadsDoNotChangeIt) {
  const std::vector<HaloRun> runs = {{0.7, 2}, {0.85, 2}, {0.9, 2}};
  const HaloLibrary one(runs, 20000, 5, 1, [](int, int) {});
  const HaloLibrary three(runs, 20000, 5, 3, [](int, int) {});
  for (const HaloRun& run : runs) {
    EXPECT_EQ(one.profile(run.q, 1).radiance(ln_rad(2)), three.profile(run.q, 1).radiance(ln_rad(2)));
  }
}

}  // namespace
}  // namespace lampglow::simulation
