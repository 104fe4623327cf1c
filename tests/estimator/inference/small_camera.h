// The camera and lens of the small scenes that the fit's tests are made of.
#pragma once

#include <cmath>

#include "estimator/inference/scene.h"

namespace lampglow::inference {

inline Camera pinhole(int width_px, int height_px, double focal_length_px) {
  Camera camera;
  camera.width_px = width_px;
  camera.height_px = height_px;
  camera.focal_length_px = focal_length_px;
  camera.principal_x_px = width_px / 2.0;
  camera.principal_y_px = height_px / 2.0;
  return camera;
}

// A core of 5 px that holds 95 %, and a glare that falls as a power of the angle.
inline PointSpread plain_spread(double focal_length_px, int nodes) {
  constexpr double kPower = 2.6;
  PointSpread spread;
  spread.core_theta_rad = 5.0 / focal_length_px;
  spread.core_fraction = 0.95;
  for (int n = 0; n < nodes; ++n) {
    spread.theta_rad.push_back(spread.core_theta_rad * std::pow(1.2, n));
    spread.ln_density.push_back(std::log(1e-4) - kPower * n * std::log(1.2));
  }
  return spread;
}

}  // namespace lampglow::inference
