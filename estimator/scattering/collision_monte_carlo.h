// Photons of an isotropic point lamp, counted by what each of their collisions sends to the camera.
//
// The same problem as monte_carlo.h (infinite homogeneous medium, Henyey-Greenstein, optical units), for the
// corners where few photons cross a sphere within a ring: narrow angles, thick air that absorbs. There every
// collision counts (next-event estimation): by symmetry the camera may stand in any direction from the lamp,
// so a collision at radius r lies on some camera's ray of angle θ, twice, if r > b = T sin θ. Its mean over
// all cameras is
//   Σ± e^(-s±) p(α±) / (4πr² cos χ),   sin χ = b/r,
// s± the way from there to the camera, α± the angle between the photon and that ray, p averaged over the
// photon's turn about the radius. In a ring, θ or χ is drawn, whichever leaves a finite variance. Photons are
// split on their way out and cut by roulette beyond the camera, so that as many arrive in thick air as in
// thin.
//
// It shares the random numbers, the phase function and the far field with monte_carlo.h, nothing with the
// glow table.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "estimator/scattering/executor.h"
#include "estimator/scattering/monte_carlo.h"

namespace lampglow::scattering {

struct Ring {
  double inner_rad = 0, outer_rad = 0;  // 0 < inner < outer <= π/2
};

struct CollisionPhotons {
  double q = 0;          // 0..0.98
  double albedo = 1;     // (0, 1]
  double thickness = 1;  // T of the camera, > 0
  std::vector<Ring> rings;
  std::uint64_t photons_per_round = 20'000;
  int max_rounds = 50;
  // Rounds go on (4 at least) until every ring's standard deviation is below this share of all its light.
  double relative_error = 0.005;
  // And below this share of the multiply scattered light alone: where that is a small part, few rare photons
  // carry it, and a spread that is small beside all light may not have seen one of them yet.
  double relative_error_of_multiple = 0.05;
  std::uint64_t seed = 1;
  double far_margin = 2;  // see GlowPhotons
};

struct CollisionEstimate {
  std::vector<Estimate> single, multiple;  // mean radiance over each ring, per unit flux, optical units
  std::uint64_t photons = 0;
};

// Deterministic for any executor. Throws std::invalid_argument with field and constraint.
CollisionEstimate simulate_collisions(const CollisionPhotons& run, const Executor& executor = run_serially);

}  // namespace lampglow::scattering
