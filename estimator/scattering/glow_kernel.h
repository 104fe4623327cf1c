// A lamp's glow over the pixels round it: what the renderer convolves with.
#pragma once

#include <vector>

#include "estimator/scattering/medium.h"

namespace lampglow::scattering {

struct RenderOptions {
  Medium medium;
  double focal_length_px = 0;  // > 0
  bool single_only = false;    // single scattering instead of all orders
  double airlight = 0;         // horizon brightness in the picture's unit
  int depth_layers = 8;        // with a depth map: distances are interpolated between this many, even in ln R
};

// Relative to the clear picture's pixel value: glow per pixel of pixels `offset_px` away, for one distance.
// The mean over the pixel where it is steep. θ below 0.01° follows the 1/θ of the exact integral.
class GlowKernel {
 public:
  // Throws std::domain_error if T = σR is outside the glow table.
  GlowKernel(const RenderOptions& options, double distance_m);
  double at(double offset_px) const;
  // Mean over the square pixel whose centre is (dx, dy) from the lamp's.
  double pixel(double dx, double dy) const;

 private:
  double focal_, first_log_, step_;
  std::vector<double> log_value_;  // ln(θ · glow) over ln θ
};

}  // namespace lampglow::scattering
