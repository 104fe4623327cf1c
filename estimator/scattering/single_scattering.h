// Single scattering of an isotropic point lamp, by the exact airlight integral (e.g. Sun, Ramamoorthi,
// Narasimhan, Nayar, SIGGRAPH 2005; physics.md).
//
// L1(θ) = ω0 Φ/(4π) · 1/(T sin θ) · ∫_θ^π p(α) exp(-(s+d)) dα. The path is s + d = T (cos θ + sin θ
// tan(α/2)), so with t = tan(α/2) and t0 = tan(θ/2) it becomes
//   L1(θ) = ω0 Φ/(4π) · e^(-T)/(T sin θ) · ∫_t0^∞ p(α) exp(-T sin θ (t - t0)) 2/(1+t²) dt,
// smooth and without a singular end. Good to 1e-9 for θ from 0.001° to 180° and T from 1e-4 to 100.
#pragma once

#include <functional>

#include "estimator/scattering/radiance.h"

namespace lampglow::scattering {

// Henyey-Greenstein phase function, -1 < q < 1, albedo 0..1, thickness > 0, 0 < theta_rad <= π. Throws
// std::invalid_argument outside (at θ = 0 the radiance is infinite).
GlowRadiance single_scattering(double thickness, double q, double albedo, double theta_rad);

// Any phase function: p [1/sr] as a function of 1 - cos α, integrating to 1 over the sphere. `narrowest_rad`
// is the width of its finest feature at α = 0 (1 for smooth ones), from which the quadrature takes its scale;
// features that are narrow elsewhere (rainbows) need several calls' comparison by the caller.
double single_scattering(double thickness, double albedo, double theta_rad,
                         const std::function<double(double one_minus_cos_alpha)>& phase_per_sr,
                         double narrowest_rad);

}  // namespace lampglow::scattering
