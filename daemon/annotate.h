// Pictures for people: a frame as a JPEG in which every lamp is marked with its state.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/photometry/camera.h"
#include "estimator/photometry/exposure.h"
#include "estimator/site.h"

namespace lampglow::daemon {

struct JpegOptions {
  int max_width_px = 960;  // larger pictures are scaled down
  int jpeg_quality = 82;   // 1..100
};

// The exposure of a bracket that shows most: the brightest in which at most 1 % of the pixels are saturated,
// or else the darkest. Null for a bracket without exposures.
const Exposure* exposure_to_show(const Bracket& bracket, const Camera& camera);

// A plain JPEG, stretched so that the night shows: from the black level to the 99.9th percentile, with a
// gamma of 2.2 for linear cameras.
std::vector<std::uint8_t> plain_jpeg(const Image<std::uint16_t>& pixels, const Camera& camera,
                                     const JpegOptions& options = {});

// The same with a ring and the id at each lamp, coloured by its state, and boxes at the day targets.
std::vector<std::uint8_t> annotated_jpeg(const Image<std::uint16_t>& pixels, const Camera& camera,
                                         std::span<const LampFit> lamps, std::span<const Target> targets = {},
                                         const JpegOptions& options = {});

// "#3fb950": the colour that stands for a state in pictures and pages.
std::string state_colour(LampState state);

}  // namespace lampglow::daemon
