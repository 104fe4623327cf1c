// The far field's constant against photons that know nothing of it.
#include "estimator/scattering/far_field.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/scattering/phase_function.h"

namespace lampglow::scattering {
namespace {

// Share of photons that leave a black sphere evenly and never come back to it. Beyond 30 transport mean free
// paths the law under test closes the account: an error of 1 % of it there changes the share by 2e-4.
double share_that_escapes(double q, double radius_in_transport_lengths, int photons) {
  const HenyeyGreenstein phase(q);
  const double transport = 1 / (1 - q), radius = radius_in_transport_lengths * transport;
  const double end = radius + 30 * transport;
  const FarField law(radius, q);
  Random random(7);
  int escaped = 0;
  for (int i = 0; i < photons; ++i) {
    double r = radius, cosine = std::sqrt(random.uniform()), sine = std::sqrt(1 - cosine * cosine);
    for (;;) {
      const double from = r * cosine, to = from - std::log(random.open_uniform()), miss = r * sine;
      const double surface = miss < radius ? -std::sqrt((radius - miss) * (radius + miss)) : 0;
      if (miss < radius && from < surface && to > surface) break;
      r = std::hypot(to, miss);
      cosine = to / r;
      sine = miss / r;
      if (r > end) {
        escaped += !law.comes_back(r, cosine, random);
        break;
      }
      const double cos_alpha = phase.sample(random.uniform()), turn = random.uniform(0, 2 * std::numbers::pi);
      const double sin_alpha = std::sqrt(std::max(0.0, 1 - cos_alpha * cos_alpha));
      const double in_plane = sin_alpha * std::cos(turn), across = sin_alpha * std::sin(turn);
      const double tilted = sine * cos_alpha + cosine * in_plane;
      cosine = cosine * cos_alpha - sine * in_plane;
      sine = std::hypot(tilted, across);
    }
  }
  return static_cast<double>(escaped) / photons;
}

TEST(FarField, ExtrapolationDistanceIsThatOfCountedPhotons) {
  for (const double q : {0.0, 0.5, 0.85}) {
    const int photons = q > 0.8 ? 15'000 : 40'000;
    const double share = share_that_escapes(q, 2, photons);
    const double extrapolation = 4 / (3 * share) - 2;
    const double sigma = 4 / (3 * share * share) * std::sqrt(share * (1 - share) / photons);
    EXPECT_NEAR(milne_extrapolation(2, q), extrapolation, 3 * sigma) << q;
    EXPECT_LT(sigma, 0.03);
  }
}

TEST(FarField, HasTheExactLimits) {
  for (const double q : {0.0, 0.9}) {
    EXPECT_NEAR(milne_extrapolation(1e9, q), 0.7104, 1e-6);
    EXPECT_NEAR(milne_extrapolation(0, q), 4.0 / 3, 1e-4);
  }
}

}  // namespace
}  // namespace lampglow::scattering
