// How noisy one exposure is: shot noise, read noise, quantisation and compression.
#pragma once

#include <span>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/exposure.h"

namespace lampglow::photometry {

// Variance of a pixel in linear DN², at linear signal x: gain · max(x, 0) + read², and on top of it, for each
// DN step, slope² · code². (Janesick, Photon Transfer, 2007, eq. 5.1; the last term is what quantisation and
// JPEG do before the curve is undone.)
struct NoiseModel {
  double gain_dn_per_electron = 0;  // linear DN per electron at this exposure's gain
  double read_noise_dn = 0;         // linear DN
  double code_noise_dn = 0;         // DN as coded: quantisation 1/sqrt(12), with compression
  bool measured = false;            // false: the camera file said both gain and read noise
};

// The noise of an exposure. What the camera file gives is taken; the rest is measured on the picture's flat
// parts (second differences of pixels in small blocks, lower quartile over blocks of like brightness), with a
// full well of 15000 electrons where the picture is too dark to tell. `linear` is linear_table(camera).
NoiseModel noise_model(const Exposure& exposure, const Camera& camera, std::span<const float> linear);

}  // namespace lampglow::photometry
