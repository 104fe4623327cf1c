// Diffusion of a lamp's light: the lecture's counter-example, and the dipole of translucent materials beside
// it.
#pragma once

#include "estimator/scattering/medium.h"
#include "estimator/scattering/radiance.h"

namespace lampglow::scattering {

// An isotropic point lamp in an infinite medium (Ishimaru, Wave Propagation and Scattering in Random Media,
// 1978, ch. 9). In optical units, with the transport coefficient 1 - ω0 q, D = 1/(3(1 - ω0 q)) and κ² = (1 -
// ω0)/D:
//   U(r) = e^(-κr)/(4πDr),  F(r) = -D U'(r),  L(T, θ) = (U + 3 F cos θ)/4π,
// never less than 0. μ_s' = (1-q) ω0 σ enters through D: 1 - ω0 q = (1-ω0) + (1-q) ω0. All light is in it,
// direct light too: diffusion knows no beam. thickness > 0, |q| < 1, 0 < albedo <= 1, any θ.
GlowRadiance diffusion_radiance(double thickness, double q, double albedo, double theta_rad);

// Fluence rate U per unit flux, optical units.
double diffusion_fluence_rate(double thickness, double q, double albedo);

// Diffuse reflectance R_d(r) [1/m²] of a half space lit by a thin beam, at r metres from it: dipole of
// Jensen, Marschner, Levoy, Hanrahan (SIGGRAPH 2001, eq. 4). relative_index is the ratio of refractive
// indices, 1..2.
double dipole_reflectance_per_m2(const Medium& medium, double relative_index, double radius_m);

}  // namespace lampglow::scattering
