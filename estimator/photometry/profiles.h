// Ring profiles: the mean brightness in rings round every lamp, the only thing of a picture that the fit
// sees. What neighbours add to a ring is the model's affair.
#pragma once

#include <cstdint>
#include <vector>

#include "estimator/photometry/image.h"
#include "estimator/photometry/ring_map.h"

namespace lampglow::photometry {

struct RingMean {
  double mean = 0;      // linear radiance units
  double variance = 0;  // of the mean, from the scatter and the pixels' own variance, whichever is larger
  int pixels = 0;       // 0: no value (saturated, masked or outside)
  double saturated_fraction = 0;
};

// Linear radiance of a frame as its parts: values, variances and mask bits. The frame's lamps lie at the
// reference's positions turned by rotation_rad about the picture's middle, then shifted.
struct FrameView {
  const Image<float>& radiance;
  const Image<float>& variance;
  const Image<std::uint8_t>& mask;
  std::uint8_t bad_bits = 0;        // hot, invalid or foreign light: left out
  std::uint8_t saturated_bits = 0;  // a ring with more than 1 % of these has no value
  double shift_x_px = 0, shift_y_px = 0, rotation_rad = 0;
};

// One RingMean per ring of the map.
std::vector<RingMean> measure_rings(const FrameView& frame, const RingMap& map);

}  // namespace lampglow::photometry
