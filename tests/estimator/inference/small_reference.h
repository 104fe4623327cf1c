// The clear reference of five lamps L1 to L5 and a light in no catalogue, for tests of what nights teach.
#pragma once

#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "estimator/inference/reference.h"
#include "tests/estimator/inference/small_camera.h"

namespace lampglow::inference {

inline constexpr double kDistances_m[] = {60, 120, 300, 600, 1200};
inline Camera camera() {
  return pinhole(200, 100, 300);
}

inline ClearReference reference() {
  ClearReference reference;
  std::vector<SceneLamp> lamps;
  std::vector<photometry::RingCentre> centres;
  for (const double distance_m : kDistances_m) {
    SceneLamp lamp;
    lamp.id = "L" + std::to_string(lamps.size() + 1);
    lamp.x_px = 20 + 40.0 * static_cast<double>(lamps.size());
    lamp.y_px = 50;
    lamp.distance_m = distance_m;
    lamp.ln_strength = 10;
    lamps.push_back(lamp);
    centres.push_back({lamp.x_px, lamp.y_px, 1000});
    reference.lamps.push_back({lamp.id, lamp.x_px, lamp.y_px, std::exp(10), 0.06, true});
    reference.catalogue.push_back({lamp.id, lamp.x_px, lamp.y_px, 0.1, 500.0});
  }
  lamps.push_back(lamps.back());
  lamps.back().id = "stray-1";
  lamps.back().catalogued = false;
  lamps.back().x_px = 190;
  centres.push_back({190, 20, 1000});
  reference.lamps.push_back({"stray-1", 190, 20, std::exp(10), 0.06, false});
  reference.catalogue.push_back({"stray-1", 190, 20, 0.1, 500.0});
  const PointSpread spread = plain_spread(300, 10);
  reference.spread = spread;
  reference.rings =
      std::make_shared<const photometry::RingMap>(photometry::make_ring_map(camera(), centres, {.rings = 8}));
  reference.scene = std::make_shared<const Scene>(camera(), lamps, spread, *reference.rings);
  return reference;
}

}  // namespace lampglow::inference
