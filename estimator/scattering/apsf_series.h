// The analytic atmospheric point spread function of Narasimhan and Nayar (Shedding light on the weather, CVPR
// 2003, eqs. 4-6), faithfully, for comparison. It does not solve the transfer equation near the lamp: it has
// no 1/θ cusp and is nearly flat inside 10° (physics.md); the glow table is the measuring model.
//
//   I(T, μ) = Σ_(m>=0) (g_m(T) + g_(m+1)(T)) L_m(μ),  g_0 = 0,  g_m = I0 exp(-β_m T - α_m ln T),
//   α_m = m + 1,  β_m = (2m+1)/m · (1 - q^(m-1)).
//
// A lecture transcript prints g_m = I0 exp[-(m+1) T - ...]; the published form has (m+1) ln T, as here. Since
// g_m then falls as T^-(m+1), the series converges for T > 1 only. I0 is the lamp's radiant intensity, 1/(4π)
// per unit flux. The model has no albedo.
#pragma once

#include <span>

#include "estimator/scattering/radiance.h"

namespace lampglow::scattering {

inline constexpr double kApsfRelativeError = 1e-6;

// Throws std::domain_error for T <= 1 (with the reason) or q outside 0..1 (exclusive of 1), and if more than
// a million terms would be needed (T within some 1e-5 of 1). The remainder, bounded by the geometric series
// of T^-1, is below relative_error times the radiance at θ = 0. 0 <= theta_rad <= π.
GlowRadiance apsf_series(double thickness, double q, double theta_rad,
                         double relative_error = kApsfRelativeError);

// The same for many angles at once; the terms are computed once. All spans have the length of theta_rad.
void apsf_series(double thickness, double q, std::span<const double> theta_rad, std::span<GlowRadiance> out,
                 double relative_error = kApsfRelativeError);

// The number of terms that this takes.
int apsf_series_terms(double thickness, double q, double relative_error = kApsfRelativeError);

}  // namespace lampglow::scattering
