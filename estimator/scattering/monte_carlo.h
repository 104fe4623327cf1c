// Photons of an isotropic point lamp in an infinite homogeneous medium with Henyey-Greenstein scattering.
//
// Everything is in optical units: lengths are multiplied by the extinction coefficient σ. The camera stands
// at optical distance T from the lamp; θ is the angle between its view ray and the lamp. By symmetry every
// point of the sphere of radius T sees the same, so photons are counted on whole spheres: radiance in an
// angle bin is Σ weight/|cos θ| / (N · 4πT² · Ω_bin), per unit emitted flux; times σ² it is W/m²/sr per W.
// One run of one q serves all T, and several albedos ride along as weights ω0^n, n the number of scatterings.
//
// This is the independent check of the glow table: it shares no code with it but the random numbers. Example:
//
//   GlowPhotons run{.q = 0.85, .albedos = {1.0}, .thicknesses = {0.5, 2}, .photons = 2'000'000};
//   run.theta_edges_rad = log_spaced_edges_rad(0.02, 90, 40);
//   GlowEstimate glow = simulate_glow(run);
//   Estimate ring = glow.total(0, 1, 12);   // albedo 0, thickness 1, bin 12: mean radiance over the bin
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "estimator/scattering/executor.h"

namespace lampglow::scattering {

struct GlowPhotons {
  double q = 0;                         // -0.99..0.99
  std::vector<double> albedos = {1};    // each in (0, 1]
  std::vector<double> thicknesses;      // T of the counting spheres, > 0, ascending
  std::vector<double> theta_edges_rad;  // edges of the angle bins, ascending, within 0..π
  std::uint64_t photons = 1'000'000;    // rounded up to a multiple of kPhotonBlocks
  std::uint64_t seed = 1;
  // Photons farther out than the largest sphere by this many transport mean free paths 1/(1-q) are not
  // followed but return by the law of diffusion, see far_field.h.
  double far_margin = 2;
  // Set, photons beyond this radius are lost instead: a finite ball of fog, as in a path tracer's scene. It
  // must lie outside the largest sphere.
  std::optional<double> black_radius;
};

// Photons go in this many blocks, each with a random stream of its own; the spread between blocks gives the
// statistical error, and the sums do not depend on who computes which block.
inline constexpr std::size_t kPhotonBlocks = 64;

struct Estimate {
  double value = 0;
  double sigma = 0;  // one standard deviation
};

class GlowEstimate {
 public:
  // Mean radiance over the bin, per unit flux, optical units: light scattered once, more than once, and both.
  // Indices as in GlowPhotons; bin b is between edges b and b+1.
  Estimate single(std::size_t albedo, std::size_t thickness, std::size_t bin) const;
  Estimate multiple(std::size_t albedo, std::size_t thickness, std::size_t bin) const;
  Estimate total(std::size_t albedo, std::size_t thickness, std::size_t bin) const;

  std::size_t bins() const { return bins_; }
  std::uint64_t photons() const { return photons_; }

 private:
  friend GlowEstimate simulate_glow(const GlowPhotons&, const Executor&);
  std::size_t index(std::size_t albedo, std::size_t thickness, std::size_t bin) const {
    return (albedo * thicknesses_ + thickness) * bins_ + bin;
  }
  std::size_t thicknesses_ = 0, bins_ = 0;
  std::uint64_t photons_ = 0;
  std::vector<Estimate> single_, multiple_, total_;
};

// Throws std::invalid_argument with field and constraint for a run that cannot be.
GlowEstimate simulate_glow(const GlowPhotons& run, const Executor& executor = run_serially);

// count+1 edges from first to last degree, evenly spaced in ln θ.
std::vector<double> log_spaced_edges_rad(double first_deg, double last_deg, std::size_t count);

// Solid angle of the cone shell between two angles [sr].
double ring_solid_angle_sr(double inner_rad, double outer_rad);

}  // namespace lampglow::scattering
