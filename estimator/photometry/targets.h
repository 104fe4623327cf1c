// Finding what a camera can use by day: the skyline, the horizon sky above it, and textured places that keep
// still.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::photometry {

struct DaySurveyOptions {
  int cells_across = 16;   // the picture's width is cut into so many boxes, as high as wide
  double least_snr = 12;   // gradient energy over noise, in the median of the frames
  double edge_part = 0.3;  // of a box's columns that the skyline must cross to call it skyline
  int most_targets = 200;  // the strongest are kept
};

struct DaySurvey {
  std::vector<Target> targets;  // ids "day-ROW-COLUMN" of the grid
  std::vector<bool> skyline;    // of each target: the sky's edge runs through its box
  std::vector<int> skyline_px;  // of each picture column: first row that is no sky; -1 if none
  DayCalibration day;           // the sky box; the rest is not learned yet
};

// From one or several clear daylight frames of one camera, all of the same size. Empty targets if none shows
// a sky above something darker. Throws std::invalid_argument for frames of different sizes.
DaySurvey survey_day(std::span<const RadianceImage> clear, const DaySurveyOptions& options = {});

}  // namespace lampglow::photometry
