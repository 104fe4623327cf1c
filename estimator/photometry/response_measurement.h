// The camera's response curve, measured from one bracket of a scene that stands still.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "estimator/photometry/exposure.h"

namespace lampglow::photometry {

enum class ResponseMethod { debevec, robertson };

struct MeasuredResponse {
  // Relative radiance for each DN, 2^bit_depth entries, 0 at DN 0, 1 at the highest, never falling
  // (Response::curve).
  std::vector<double> curve;
  int samples = 0;  // places in the picture that were used
  int exposures = 0;
  double rms_rel = 0;     // scatter of the exposures' radiances of one place about their mean, by this curve
  double best_gamma = 1;  // of the power law nearest to the curve: 1 is a linear camera, 2.2 about sRGB
};

// By Debevec and Malik 1997, or Robertson et al. 1999, as OpenCV has them: on 256 levels, so that a curve of
// a deeper camera is measured in steps of 2^(bit_depth - 8) and interpolated. Places are chosen evenly over
// the brightness range where the picture is flat and no exposure disagrees with the order of the others.
// Throws std::invalid_argument: fewer than two exposures of different, known time, of unlike size, or too few
// places (says which).
MeasuredResponse measure_response(std::span<const Exposure> exposures, int bit_depth, ResponseMethod method);

}  // namespace lampglow::photometry
