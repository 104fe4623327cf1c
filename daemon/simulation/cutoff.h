// Cut-off luminaires: a Lambertian disc that faces down, over a ground of albedo 0.2. Nothing of it is even,
// so each lamp of each frame has photons of its own, followed backward from the camera.
#pragma once

#include "daemon/simulation/halo.h"
#include "daemon/simulation/night.h"

namespace lampglow::simulation {

// Towards the camera, against a lamp that is seen 5° below its plane: the disc's cosine law.
double cutoff_intensity(const Lamp& lamp);

// Photons' radiance by angle and azimuth, per irradiance that the lamp's direct beam would give without air.
// The ground's lit pool is in it.
HaloProfile cutoff_halo(const Night& night, const Frame& frame, size_t lamp);

}  // namespace lampglow::simulation
