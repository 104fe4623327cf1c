// Text bands that cameras write into the picture (name, date, time): black rows at the top or bottom edge.
#pragma once

#include <cstdint>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/image.h"

namespace lampglow::photometry {

struct OverlayRows {
  int top = 0;     // rows at the top edge that are no picture
  int bottom = 0;  // and at the bottom edge
};

// Rows at an edge, at most a tenth of the picture, that are mostly one and the same black (text may stand in
// them) and end with a jump to a brighter, noisy picture; one row more, for the edge's blur. A picture that
// is dark all over has no band.
OverlayRows find_overlay(const Image<std::uint16_t>& pixels, const Camera& camera);

}  // namespace lampglow::photometry
