// The models of a lamp's glow behind one call, so that a fit can swap them.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace lampglow::scattering {

enum class GlowModel { table, apsf_series, single, diffusion };

std::string_view to_string(GlowModel model);  // "table", "apsf_series", "single", "diffusion"
std::optional<GlowModel> parse_glow_model(std::string_view name);

// The same as GlowTable::profile, for every model: scattered radiance per unit flux in optical units, and its
// derivatives with respect to ln T and to q. apsf_series ignores the albedo; apsf_series and diffusion do not
// tell the direct beam from scattered light. Throws std::domain_error outside the model's domain, see
// outside_glow_model(). Cost of 64 angles: table some µs; single some 100 µs; apsf_series grows as 1/ln T.
void glow_profile(GlowModel model, double thickness, double q, double albedo,
                  std::span<const double> theta_rad, std::span<double> total,
                  std::span<double> d_ln_thickness, std::span<double> d_q);

// Why the model has no value here; empty if it has. For a fit's flag: never throws.
//   table        T 0.01..15, q 0..0.97, ω0 0.8..1, θ 0.01°..90°
//   apsf_series  T 1.001..100, q 0..0.99, θ 0..180°
//   single       T 0.001..20, q -0.97..0.97, ω0 0..1, θ 0.01°..180°
//   diffusion    T 0.001..100, q -0.97..0.97, ω0 0.01..1, any θ (radiance 0, where the formula is negative)
std::string outside_glow_model(GlowModel model, double thickness, double q, double albedo,
                               std::span<const double> theta_rad);

}  // namespace lampglow::scattering
