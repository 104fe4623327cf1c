// The transfer equation of an isotropic point lamp in an infinite homogeneous medium, solved without photons.
//
// In Fourier space the Legendre moments of the radiance obey a tridiagonal system (Case and Zweifel, Linear
// Transport Theory, 1967, ch. 2; here with k real, optical units):
//   (2l+1)(1 - ω0 q^l) φ_l + k (l+1) φ_(l+1) - k l φ_(l-1) = s_l.
// With s_l = δ_l0 and ω0 = 0 it gives the direct beam φ⁰; with s_l = (2l+1) ω0 q^l φ⁰_l all light that was
// scattered at least once, so nothing cancels. Beyond l = L, where q^L is negligible, the system is that of
// free streaming and is closed by its exact ratio: no truncation as in a P_N approximation. Back in space,
//   φ_l(r) = 1/(2π²) ∫ k² φ_l(k) j_l(kr) dk,
// done for all r at once on a logarithmic grid (Hamilton 2000, MNRAS 312, 257, appendix B). The light that
// was scattered at least twice is the line integral of what these moments scatter once more,
//   L(T, θ) = ∫ J(r, μ) e^(-s) ds,  J = ω0/(4π) Σ (2l+1) q^l φ_l(r) P_l(μ),
// which converges with q^l although the radiance itself is singular at θ = 0.
#pragma once

#include <cstddef>
#include <memory>
#include <vector>

namespace lampglow::scattering {

// What does not depend on the albedo, for one q. Costs some 10 MB and a fraction of a second.
class TransferKernel {
 public:
  // -0.9 <= q <= 0.98. Throws std::invalid_argument outside.
  explicit TransferKernel(double q);
  ~TransferKernel();
  TransferKernel(TransferKernel&&) noexcept;

  struct Data;
  const Data& data() const { return *data_; }

 private:
  std::unique_ptr<Data> data_;
};

class TransferSolution {
 public:
  // 0 < albedo <= 1.
  TransferSolution(const TransferKernel& kernel, double albedo);

  // Radiance of all light scattered at least twice, per unit flux, optical units. 0.001 <= T <= 50,
  // 0 < theta_rad < π.
  double multiple(double thickness, double theta_rad) const;

  // Fluence rate of light scattered at least once; used in tests against known solutions.
  double scattered_fluence_rate(double radius) const;

 private:
  double source_times_radius(double radius, double cosine) const;

  std::size_t orders_ = 0;  // L
  double first_log_radius_ = 0, step_ = 0;
  std::vector<double> moments_;  // r φ_l (2l+1) ω0 q^l / 4π, [radius][l]
  std::vector<double> fluence_;  // r φ_0, [radius]
  std::vector<double> recurrence_a_, recurrence_b_;
};

}  // namespace lampglow::scattering
