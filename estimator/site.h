// Where a camera stands and what it sees: the site file's content ([site], [camera], [[light]], [[target]]).
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "estimator/photometry/camera.h"

namespace lampglow {

// A lamp of the catalogue. What `calibrate` learned about it stands here too, each with one standard
// deviation.
struct Light {
  std::string id;
  double x_px = 0;  // pixel centres at .5, in the clear reference, ±1 px
  double y_px = 0;
  std::optional<double> distance_m;
  std::optional<double> distance_sigma_m;  // empty: distance is known exactly
};

// A dark object for the day.
struct Target {
  std::string id;
  double x_px = 0, y_px = 0, width_px = 0, height_px = 0;  // its box
  std::optional<double> distance_m;
  std::optional<double> distance_sigma_m;
};

// What `calibrate` learned of the night where lamps' distances, angle of view and exposure are unknown: how
// ln σ follows from the brightness of the picture's patches (inference/patches.h). Row by row; all three
// lists of one length.
struct NightCalibration {
  int patch_px = 32;
  double log_extinction_mean = 0;
  double log_extinction_sigma = 0;                         // error that cross-validation found, > 0
  double log_extinction_low = 0, log_extinction_high = 0;  // the range it was learned from
  std::vector<double> mean, scale, weight;
};

struct Site {
  std::string name;
  std::optional<double> latitude_deg;   // north positive
  std::optional<double> longitude_deg;  // east positive
  std::optional<double> elevation_m;
  Camera camera;
  std::vector<Light> lights;
  std::vector<Target> targets;
  std::optional<NightCalibration> night;
};

}  // namespace lampglow
