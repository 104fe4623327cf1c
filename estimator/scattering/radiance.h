// What every model of the glow gives: scattered radiance and how it changes with the air.
#pragma once

namespace lampglow::scattering {

// Radiance per unit emitted flux in optical units (times σ² it is W/m²/sr per W). The derivatives are of this
// optical quantity, with respect to ln T at fixed q, albedo and θ, and to q at fixed T, albedo and θ. In a
// fit with fixed distance R the radiance is σ² value(T = σR), so ∂/∂ln σ = σ² (d_ln_thickness + 2 value).
struct GlowRadiance {
  double value = 0;
  double d_ln_thickness = 0;
  double d_q = 0;
};

}  // namespace lampglow::scattering
