// The sensor: photons to digital numbers.
#pragma once

#include <cstdint>
#include <vector>

#include "daemon/simulation/random.h"
#include "estimator/photometry/image.h"

namespace lampglow::simulation {

struct Sensor {
  int bit_depth = 12;
  double black_level_dn = 64;
  double saturation_dn = 4095;
  double gain_dn_per_electron = 0.269;
  double read_noise_dn = 0.8;
  bool srgb = false;  // the linear signal goes through the sRGB curve to 8 bits
};

Sensor bracket_sensor();
Sensor webcam_sensor();

struct HotPixel {
  int column = 0, row = 0;
  double electrons_per_s = 0;
};

// The same for every picture of a camera.
std::vector<HotPixel> draw_hot_pixels(int width_px, int height_px, Random& random);

// One exposure of a picture of expected electrons per second. Shot noise, read noise, black level,
// saturation.
Image<std::uint16_t> expose(const Image<double>& electrons_per_s, double exposure_s, const Sensor& sensor,
                            const std::vector<HotPixel>& hot_pixels, Random& random);

// The variance, in electrons², of one pixel that expects this many electrons; empty where it saturates.
double noise_variance(const Sensor& sensor, double electrons);
double saturation_electrons(const Sensor& sensor);

}  // namespace lampglow::simulation
