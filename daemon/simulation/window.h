// Water on the window before the lens. Each drop is a little lens a few centimetres in front of a camera that
// is focused on infinity: it turns the rays that go through it towards its middle (so it shows the scene
// upside down, up to 20° from where it stands), and as rays through the whole aperture make up one pixel, its
// rim is soft and the scene shines through beside it.
#pragma once

#include <vector>

#include "estimator/photometry/image.h"

namespace lampglow::simulation {

// On the window's plane. A drop that has run down leaves a streak of `streak_mm` above it.
struct Drop {
  double x_mm = 0, y_mm = 0;  // from the optical axis, right and down
  double radius_mm = 1;
  double streak_mm = 0;
  double rim_slope = 0.7;  // of the water's surface at the rim: tan of the contact angle
};

inline constexpr double kWindowDistance_mm = 80;
inline constexpr double kAperture_mm = 2;

// Part of the picture's area on the window that water covers, 0..1.
double covered_part(const std::vector<Drop>& drops);

// What the camera sees through the drops of a scene (of the camera's picture size) that it would see without.
Image<double> seen_through(const Image<double>& scene, const std::vector<Drop>& drops);

}  // namespace lampglow::simulation
