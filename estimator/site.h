// Where a camera stands and what it sees: the site file's content ([site], [camera], [[light]], [[target]]).
#pragma once

#include <array>
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

// How a target's texture stands out in clear air, as `calibrate` learned it. Contrast is the root mean square
// luminance gradient within the box over the horizon sky, both linear.
struct TargetContrast {
  double log_contrast = 0;        // ln of it, freed of haze, in the middle of the lighting it was learned in
  double log_contrast_sigma = 0;  // what is left unexplained from frame to frame, > 0
  double log_floor = -10;         // ln of what stays in the thickest fog (dirt on the window) over it
  std::array<double, 2> lighting{};  // change of ln contrast with the frame's two common lighting factors
};

// How a target looked in the clear references, through a dry window: what inference/day_reference.h learns at
// the start. Over the columns of its box: see inference/window.h.
struct TargetClear {
  std::vector<double> sharp, contrast;
  double halves = 0;  // TargetView::halves
};

// A dark or textured object for the day.
struct Target {
  std::string id;
  double x_px = 0, y_px = 0, width_px = 0, height_px = 0;  // its box
  std::optional<double> distance_m;
  std::optional<double> distance_sigma_m;
  std::optional<double> brightness_ratio;  // own brightness over the horizon sky's, 0..1; learned
  std::optional<double> brightness_ratio_sigma;
  std::optional<TargetContrast> contrast;
  std::optional<TargetClear> clear;  // not in the site file
};

// What `calibrate` learned about the day as a whole.
struct DayCalibration {
  double sky_x_px = 0, sky_y_px = 0, sky_width_px = 0,
         sky_height_px = 0;         // horizon sky, where contrast is measured against
  double log_extinction_sigma = 0;  // error of ln extinction that cross-validation found
  double independent_targets = 1;   // how many targets err independently of each other
  bool colour = false;  // learned from colour pictures: the camera's monochrome night mode is another camera
};

// What `calibrate` learned where distances, angle of view and exposure are unknown: how ln σ follows from the
// picture's patches (inference/patches.h), by night and by day apart. All three lists of one length.
struct PatchCalibration {
  int patch_px = 32;
  bool texture = false;  // local contrast of the patches counts too
  bool colour = false;   // learned from colour pictures: says nothing of the camera's monochrome night mode
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
  std::optional<PatchCalibration> night;
  std::optional<PatchCalibration> day_patches;
  std::optional<DayCalibration> day;
};

}  // namespace lampglow
