// The glow table: the true glow of an isotropic point lamp in a homogeneous Henyey-Greenstein medium, fast
// enough to fit with.
//
// Logarithms of single and of multiple scattering as tensor products of cubic B-splines over sqrt(1 - ω0),
// -ln(1 - q), ln T and ln θ: values, first and second derivatives are continuous. Built by `lampglow
// glow-table` from the solution of the transfer equation (transfer_solution.h), which it follows within 2e-4,
// and the exact single scattering integral; docs/glow-table.md has the file format and how that was measured.
//
// Optical units: radiance per unit emitted flux Φ; times σ² it is W/m²/sr per W. Beside the scattered light
// stands the direct beam, an irradiance of direct_irradiance(T) = e^(-T)/(4πT²) in the same units; it is not
// in `total`.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "estimator/scattering/bspline.h"

namespace lampglow::scattering {

// Where the table is defined. Outside it, nothing is returned.
struct GlowDomain {
  double thickness_min = 0.01, thickness_max = 15;
  double q_min = 0, q_max = 0.97;
  double albedo_min = 0.8, albedo_max = 1;
  double theta_min_rad = 0.01 * 0.017453292519943295, theta_max_rad = 90 * 0.017453292519943295;

  bool contains(double thickness, double q, double albedo) const;
  bool contains_theta(double theta_rad) const;
  // What is outside, with value and limits, for a message; empty if all is inside.
  std::string outside(double thickness, double q, double albedo, std::span<const double> theta_rad) const;
};

// e^(-T)/(4πT²): irradiance of the direct beam per unit flux, optical units. Its derivative with respect to
// ln T is -(T + 2) times itself.
double direct_irradiance(double thickness);

class GlowTable {
 public:
  // Throws std::runtime_error with the reason: not a glow table, another version, cut short, or checksum
  // wrong.
  static GlowTable parse(std::span<const std::byte> file);

  const GlowDomain& domain() const { return domain_; }

  // Scattered radiance (all orders >= 1) for every θ [rad], and its derivatives with respect to ln T (at
  // fixed q, albedo, θ; see radiance.h for what that means at fixed distance) and to q (at fixed T, albedo,
  // θ). All spans have the length of theta_rad. Throws std::domain_error outside the domain and writes
  // nothing then; a fit asks domain().contains() first.
  void profile(double thickness, double q, double albedo, std::span<const double> theta_rad,
               std::span<double> total, std::span<double> d_ln_thickness, std::span<double> d_q) const;

  // The same split into light scattered once and more than once, without derivatives.
  void parts(double thickness, double q, double albedo, std::span<const double> theta_rad,
             std::span<double> single, std::span<double> multiple) const;

 private:
  friend class GlowAtAngles;
  static constexpr std::size_t kAlbedo = 0, kQ = 1, kThickness = 2, kTheta = 3;
  struct Rows;
  Rows contract(double thickness, double q, double albedo, bool derivatives) const;
  void check(double thickness, double q, double albedo, std::span<const double> theta_rad) const;

  GlowDomain domain_;
  std::array<SplineAxis, 4> axes_;
  std::vector<float> single_;    // [q][T][θ]: ln(L1 / ω0)
  std::vector<float> multiple_;  // [ω0][q][T][θ]: ln(L2+ / ω0²)
};

// The table at angles and an albedo that stay the same, as a fit asks it some thousand times a frame: splines
// along θ and ω0 are then evaluated once and for all.
class GlowAtAngles {
 public:
  // Throws std::domain_error outside the table's domain.
  GlowAtAngles(const GlowTable& table, double albedo, std::span<const double> theta_rad);

  // As GlowTable::profile() at those angles, to rounding. Both derivatives may be empty: not wanted.
  void profile(double thickness, double q, std::span<double> total, std::span<double> d_ln_thickness,
               std::span<double> d_q) const;

 private:
  struct Sums;
  void contract(const std::vector<double>& coefficients, double thickness, double q, Sums& sums) const;

  GlowDomain domain_;
  SplineAxis q_axis_{}, thickness_axis_{};
  double albedo_ = 1;
  std::size_t angles_ = 0;
  std::vector<double> single_, multiple_;  // [q][T][angle]: ln(L1 / ω0), ln(L2+ / ω0²)
};

// The table that is part of this library; parsed once, at first use. Safe from any thread.
const GlowTable& default_glow_table();

}  // namespace lampglow::scattering
