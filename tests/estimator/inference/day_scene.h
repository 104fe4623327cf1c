// A daylight picture for tests: dark boxes on the horizon through attenuation and airlight, with what the fit
// does not know: the sky's gradient and mottle, the targets' own brightness and texture, uneven haze, noise.
#pragma once

#include <cmath>
#include <random>
#include <vector>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::testing {

struct DayScene {
  Site site;
  std::vector<double> distances_m;
};

inline DayScene day_scene(const std::vector<double>& distances_m) {
  DayScene scene;
  scene.distances_m = distances_m;
  scene.site.camera.width_px = 320;
  scene.site.camera.height_px = 200;
  scene.site.camera.bit_depth = 12;
  scene.site.camera.saturation_dn = 4095;
  for (size_t i = 0; i < distances_m.size(); ++i) {
    Target target;
    target.id = "T" + std::to_string(i);
    target.x_px = 20 + 75.0 * static_cast<double>(i), target.y_px = 90;
    target.width_px = 40, target.height_px = 30;
    target.distance_m = distances_m[i];
    scene.site.targets.push_back(target);
  }
  return scene;
}

// `sky_shows`: rows of sky in the upper part of each target's box. `lit`: times the targets' usual
// brightness.
inline photometry::RadianceImage draw_day(const DayScene& scene, double sigma, std::mt19937_64& random,
                                          int sky_shows = 4, double lit = 1) {
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const int width = scene.site.camera.width_px, height = scene.site.camera.height_px, horizon = 122;
  const double airlight = 1500 + 1000 * uniform(random), gradient = (uniform(random) - 0.5) * 1.0;  // per row
  const double sun = uniform(random);  // lights all targets alike
  photometry::RadianceImage image;
  image.radiance = Image<float>(width, height);
  image.variance = Image<float>(width, height);
  image.mask = Image<std::uint8_t>(width, height);
  image.saturation_radiance = 4095;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      double value = airlight + gradient * (horizon - y) + 4 * std::sin(x / 37.0);
      if (y >= horizon)
        value = airlight * (0.25 + 0.75 * (1 - std::exp(-sigma * 8000.0 / (y - horizon + 1))));
      image.radiance.at(x, y) = static_cast<float>(value);
    }
  for (size_t i = 0; i < scene.distances_m.size(); ++i) {
    const Target& box = scene.site.targets[i];
    const double own = lit * (0.02 + 0.06 * sun + 0.07 * uniform(random));
    const double t = std::exp(-sigma * (1 + 0.05 * normal(random)) * scene.distances_m[i]);
    const double horizon_there = airlight * (1 + 0.005 * normal(random));
    for (int y = static_cast<int>(box.y_px) + sky_shows; y < static_cast<int>(box.y_px + box.height_px); ++y)
      for (int x = static_cast<int>(box.x_px); x < static_cast<int>(box.x_px + box.width_px); ++x) {
        const double surface = own * airlight * (1 + 0.2 * normal(random));
        image.radiance.at(x, y) = static_cast<float>(surface * t + horizon_there * (1 - t));
      }
  }
  for (size_t i = 0; i < image.radiance.pixels.size(); ++i) {
    const double variance = image.radiance.pixels[i] * 0.25 + 4;
    image.radiance.pixels[i] += static_cast<float>(std::sqrt(variance) * normal(random));
    image.variance.pixels[i] = static_cast<float>(variance);
  }
  return image;
}

}  // namespace lampglow::testing
