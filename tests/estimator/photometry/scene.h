// Made scenes with real photon statistics, for the tests of photometry. The truth is a picture of radiance in
// electrons per second; a camera takes exposures of it with Poisson photons, Gaussian read noise, its
// response and its clipping.
#pragma once

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/exposure.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/response.h"

namespace lampglow::photometry::scene {

struct Lamp {
  double x_px, y_px;
  double electrons_per_s;  // in all
  double psf_sigma_px = 0.9;
  double halo_part = 0.02;  // of the light, in a halo falling as 1/(1 + (r/r0)²)^1.5
  double halo_px = 12;
};

// The light of `lamp` on every pixel; the core integrated over pixels exactly.
inline void add_lamp(Image<double>& truth, const Lamp& lamp) {
  const auto step = [&](double a) { return 0.5 * std::erf(a / (lamp.psf_sigma_px * std::sqrt(2.0))); };
  const double core = lamp.electrons_per_s * (1 - lamp.halo_part);
  const double halo =
      lamp.electrons_per_s * lamp.halo_part / (2 * 3.141592653589793 * lamp.halo_px * lamp.halo_px);
  for (int y = 0; y < truth.height_px; ++y) {
    const double part_y = step(y + 1 - lamp.y_px) - step(y - lamp.y_px);
    for (int x = 0; x < truth.width_px; ++x) {
      const double part_x = step(x + 1 - lamp.x_px) - step(x - lamp.x_px);
      const double r2 = (std::pow(x + 0.5 - lamp.x_px, 2) + std::pow(y + 0.5 - lamp.y_px, 2)) /
                        (lamp.halo_px * lamp.halo_px);
      truth.at(x, y) += core * part_x * part_y + halo / ((1 + r2) * std::sqrt(1 + r2));
    }
  }
}

inline Camera camera_12_bit(int width, int height) {
  Camera camera;
  camera.width_px = width, camera.height_px = height;
  camera.bit_depth = 12;
  camera.black_level_dn = 64;
  camera.saturation_dn = 4095;
  camera.read_noise_dn = 0.8;
  camera.gain_dn_per_electron = 0.269;
  return camera;
}

inline Camera camera_8_bit_srgb(int width, int height) {
  Camera camera;
  camera.width_px = width, camera.height_px = height;
  camera.response.kind = Response::Kind::srgb;
  return camera;
}

// One exposure. `gain` and `read` are what the camera really has, in linear DN.
inline Exposure expose(const Image<double>& truth, const Camera& camera, double exposure_s, double gain,
                       double read, std::mt19937_64& random) {
  Exposure exposure;
  exposure.name = "scene";
  exposure.exposure_s = exposure_s;
  exposure.pixels = Image<std::uint16_t>(truth.width_px, truth.height_px);
  std::normal_distribution<double> normal(0, 1);
  const double range = camera.saturation_dn - camera.black_level_dn,
               highest = std::exp2(camera.bit_depth) - 1;
  for (size_t i = 0; i < truth.pixels.size(); ++i) {
    const double electrons = static_cast<double>(
        std::poisson_distribution<long>(std::max(truth.pixels[i] * exposure_s, 1e-9))(random));
    double code = gain * electrons + read * normal(random);
    if (camera.response.kind == Response::Kind::srgb) code = range * linear_to_srgb(code / range);
    const double dn = std::round(camera.black_level_dn + code);
    exposure.pixels.pixels[i] =
        static_cast<std::uint16_t>(std::clamp(dn, 0.0, std::min(highest, camera.saturation_dn)));
  }
  return exposure;
}

inline Bracket bracket(const Image<double>& truth, const Camera& camera, const std::vector<double>& times_s,
                       std::mt19937_64& random) {
  Bracket result;
  for (const double t : times_s)
    result.exposures.push_back(
        expose(truth, camera, t, camera.gain_dn_per_electron.value(), camera.read_noise_dn.value(), random));
  return result;
}

}  // namespace lampglow::photometry::scene
