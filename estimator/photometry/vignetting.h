// The fall of brightness towards the picture's corners.
#pragma once

#include "estimator/photometry/camera.h"
#include "estimator/photometry/image.h"

namespace lampglow::photometry {

// Relative transmission at a distance rho from the principal point (see Camera::vignetting); 1 in the middle.
double vignetting_at(const Camera& camera, double rho);

// The greatest rho of any of the picture's corners.
double farthest_rho(const Camera& camera);

// The transmission of every pixel. Throws std::invalid_argument where it is not above 0 everywhere.
Image<float> vignetting_map(const Camera& camera);

}  // namespace lampglow::photometry
