// From digital number to light: the camera's response curve, undone.
#pragma once

#include <string>
#include <vector>

#include "estimator/photometry/camera.h"

namespace lampglow::photometry {

// IEC 61966-2-1, from a relative code value 0..1 to relative light 0..1, and back. Values outside are carried
// on along the end pieces.
double srgb_to_linear(double code);
double linear_to_srgb(double light);

// The linear signal of every digital number 0 .. 2^bit_depth - 1, in "linear DN": 0 at the black level and
// saturation_dn - black_level_dn at saturation, whatever the curve, so that linear cameras keep their unit.
// Below the black level it goes on below 0 (linear, sRGB), so that noise about black keeps its mean.
// Throws std::invalid_argument for a camera that makes no sense (see camera_fault).
std::vector<float> linear_table(const Camera& camera);

// What is wrong with the camera's radiometry, in words (field, value, constraint); empty if nothing.
std::string camera_fault(const Camera& camera);

}  // namespace lampglow::photometry
