// What becomes of a photon far from the lamp, so that none needs to be followed to infinity.
//
// A sphere of radius R takes in every photon that reaches it. Seen from outside the density of photons is
// that of diffusion, n ~ 1 - hit/r, and does not vanish at R but keeps a ratio n/n' = λ there (Milne's
// extrapolation distance), so hit = R²/(R + λ). A photon at r > R comes back with probability hit/r.
//
// λ was counted, with photons alone: by reciprocity it follows from the share P of the photons leaving a
// black sphere evenly (Lambert) that never come back, λ = 4l/(3P) - R, l = 1/(1 - q) the transport mean free
// path. Its limits are exact: 4/3 l for a small sphere (P = 1), 0.7104 l for a plane (Davison, Neutron
// Transport Theory, 1957, ch. 14). Between them λ/l = 0.7104 + c/(R/l + c/0.6229), c = c(q) fitted to the
// counts of R/l = 0.5 to 5; tests/estimator/scattering/far_field_test.cpp repeats one of them for each q.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/scattering/random.h"

namespace lampglow::scattering {

// λ in transport mean free paths; radius too. -1 < q < 1.
inline double milne_extrapolation(double radius, double q) {
  const double away = 1 - std::max(q, 0.0), curvature = 0.36 + 0.33 * away * away;
  return 0.7104 + curvature / (radius + curvature / 0.6229);
}

class FarField {
 public:
  // Photons beyond this radius (optical units) are no longer followed. It should lie two transport mean free
  // paths or more outside of whatever is looked at.
  FarField(double radius, double q)
      : radius_(radius),
        transport_length_(1 / (1 - q)),
        q_(q),
        hit_(radius * radius /
             (radius + transport_length_ * milne_extrapolation(radius / transport_length_, q))) {}

  double radius() const { return radius_; }

  // Of a photon that has its collision at `from` and came there along a direction of this cosine to the
  // outward radius: directions are remembered for one transport length. False: it never comes back.
  bool comes_back(double from, double cosine, Random& random) const {
    return random.uniform() * start(from, cosine) < hit_;
  }

  // For one that does: how often it is scattered meanwhile. First passage has Lévy's distribution,
  // (x/Z)²/2D with Z normal.
  double scatterings(double from, double cosine, Random& random) const {
    const double distance = std::max(start(from, cosine) - hit_, 0.0);
    const double normal = std::sqrt(-2 * std::log(random.open_uniform())) *
                          std::cos(2 * std::numbers::pi * random.open_uniform());
    return distance * distance * 3 / (2 * transport_length_ * normal * normal);
  }

  // The cosine to the inward radius with which it crosses the sphere: density of radiance 0.7104 + μ as
  // Milne's problem has it nearly, flux μ(0.7104 + μ).
  static double inward_cosine(Random& random) {
    constexpr double kLambert = 0.7104 / 2, kRest = 1.0 / 3;
    const bool lambert = random.uniform() * (kLambert + kRest) < kLambert;
    return lambert ? std::sqrt(random.uniform()) : std::cbrt(random.uniform());
  }

 private:
  double start(double from, double cosine) const { return from + cosine * q_ * transport_length_; }

  double radius_, transport_length_, q_, hit_;
};

}  // namespace lampglow::scattering
