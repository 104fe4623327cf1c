// The day: a skyline of dark targets against the horizon sky, seen through attenuation and airlight
// (Koschmieder 1924): E(d) = E0 exp(-σd) + E∞ (1 - exp(-σd)).
#pragma once

#include "daemon/simulation/night.h"
#include "estimator/photometry/image.h"

namespace lampglow::simulation {

// Places the targets, sets every frame's daylight and puts the lamps out while the sun is up.
void add_daylight(Night& night);

// The sky of town light and of the sun, the ground and the targets before the lens, in electrons per second
// of each pixel. The picture is larger than the camera's by the margin on every side.
void add_skyline(Image<double>& canvas, const Night& night, const Frame& frame, int margin_px);

}  // namespace lampglow::simulation
