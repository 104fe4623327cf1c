// Henyey and Greenstein's phase function (Diffuse radiation in the galaxy, ApJ 93, 1941).
//
// The lecture's P(cos α) = Σ (2m+1) q^m L_m(cos α) = (1 - q²) / (1 + q² - 2q cos α)^(3/2) integrates to 4π
// over the sphere. Everything here is p = P/4π, the probability per steradian, which integrates to 1.
#pragma once

#include <vector>

namespace lampglow::scattering {

// -1 < q < 1; the constructor throws std::invalid_argument otherwise.
class HenyeyGreenstein {
 public:
  explicit HenyeyGreenstein(double q);

  double q() const { return q_; }

  // p(cos α) [1/sr], closed form. Written with 1 - cos α so that nothing cancels near α = 0.
  double per_sr(double cos_alpha) const;
  double per_sr_from_one_minus_cos(double one_minus_cos_alpha) const;
  // dp/dq at the same angle.
  double derivative_q(double one_minus_cos_alpha) const;

  // The coefficients q^0 .. q^(count-1) of p = 1/4π Σ (2m+1) q^m L_m.
  std::vector<double> legendre(int count) const;
  // The series summed to `count` terms: what the closed form is tested against.
  double per_sr_series(double cos_alpha, int count) const;

  // Probability that the scattering angle's cosine is <= cos_alpha.
  double cumulative(double cos_alpha) const;
  // Inverse of it: maps a uniform number in [0, 1) to a cosine (Witt 1977, ApJS 35, 1, eq. 19).
  double sample(double uniform) const;

 private:
  double q_;
};

// Legendre polynomials L_0(x) .. L_(count-1)(x) by upward recurrence, -1 <= x <= 1.
std::vector<double> legendre_polynomials(double x, int count);

}  // namespace lampglow::scattering
