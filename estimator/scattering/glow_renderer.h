// Puts fog's glow into a clear picture by convolution.
//
// Every pixel is taken as an even lamp at its distance R. What a clear picture shows as radiance L of a pixel
// of solid angle Ω reaches the camera through fog as
//   e^(-T) L                                (the direct beam, Bouguer)
//   + Σ over pixels L' Ω 4πT² f(T, θ)       (its glow: f is the scattered radiance per unit flux in optical
//   units)
//   + A (1 - e^(-T))                        (airlight of the brightness A at the horizon, Koschmieder),
// T = σR, θ = atan(distance in pixels / focal length). Pictures are linear; radiance in any unit.
//
// The kernel falls from 1/θ at the lamp to many degrees, so it is split smoothly: the sharp inner part runs
// over tiles by overlap-save at full resolution, the wide rest on a picture four times coarser. Beside
// the caller's pictures it takes 17 MB for the tiles and about one more picture for the rest; a second one
// with a depth map.
#pragma once

#include <functional>
#include <span>

#include "estimator/scattering/glow_kernel.h"

namespace lampglow::scattering {

// clear, out: width*height, row by row; depth_m: the same or empty (then distance_m holds for all). Throws
// std::invalid_argument for sizes, std::domain_error for distances outside the table. progress: done, total.
void render_glow(std::span<const float> clear, int width, int height, std::span<const float> depth_m,
                 double distance_m, const RenderOptions& options, std::span<float> out,
                 const std::function<void(std::size_t, std::size_t)>& progress = {});

// The transforms that render_glow needs for one layer, and no more: forward and back for every tile and for
// the coarse picture. What the render time is compared with.
void bare_transforms(int width, int height);

}  // namespace lampglow::scattering
