// An exposure bracket, merged to one picture of linear radiance with the variance and state of each pixel.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/exposure.h"
#include "estimator/photometry/hot_pixels.h"
#include "estimator/photometry/image.h"
#include "estimator/photometry/noise.h"
#include "estimator/quality.h"

namespace lampglow::photometry {

// Bits of a pixel's mask. Only 0 is a pixel to trust without a thought.
inline constexpr std::uint8_t kSaturated = 1;  // in every exposure; its radiance is a lower bound
inline constexpr std::uint8_t kBloom = 2;  // beside a saturated pixel in every exposure it could be had from
inline constexpr std::uint8_t kHot = 4;    // hot pixel: its radiance is meaningless
inline constexpr std::uint8_t kInvalid = 8;  // no picture here: text overlay, dark frame edge

bool any_masked(std::span<const std::uint8_t> mask);

struct RadianceOptions {
  // An exposure is trusted up to this part of its range above black, and fades out of the merge over the last
  // tenth.
  double saturation_fraction = 0.98;
  // Neighbours of a saturated pixel within this distance are not trusted in that exposure. 0: none.
  int bloom_radius_px = 1;
  // Hot pixels known beforehand (learned over frames).
  std::vector<PixelIndex> hot_pixels{};
  // Also look for hot pixels in this frame alone.
  bool find_hot_pixels = true;
  // Mask black text bands at the top and bottom edge (see overlay.h).
  bool find_overlay = true;
  // Relative transmission of the lens, 0..1, of the picture's size; empty: the
  // camera's own (Camera::vignetting). 0 marks a pixel invalid.
  Image<float> vignetting{};
};

// Unit: linear DN per second at 0 dB, black level taken off. Where no exposure time is known it is the
// frame's own linear DN (`relative`): only ratios within the frame mean something.
struct RadianceImage {
  Image<float> radiance;
  Image<float> variance;                 // infinite where kSaturated, kHot or kInvalid
  Image<std::uint8_t> mask;              // 0 or the bits above
  std::vector<PixelIndex> hot_pixels{};  // that stand out in this picture, known or not; as looked for
  bool relative = false;
  bool compressed_colour =
      false;  // 8-bit colour: chroma's compression leaks into green, whole blocks at once
  double saturation_radiance = 0;  // what the shortest exposure can just hold
  double shortest_s =
      1;  // effective exposure (time times gain) of the shortest and longest used; 1 if relative
  double longest_s = 1;
  std::vector<NoiseModel> noise;  // of each exposure used, longest first
  QualityFlags quality;           // frame_wrong_size, frame_wrong_depth, frame_blank, automatic_exposure
  std::string fault;              // the same in words

  bool empty() const { return radiance.empty(); }
};

// Never throws for a bad frame: exposures of the wrong size or depth are left out and flagged; with none left
// the result is empty(). Throws std::invalid_argument for a camera or vignetting map that makes no sense.
// The merge weighs each exposure with the inverse of its variance, taken at the bracket's pooled estimate of
// the radiance, not at the exposure's own noisy value, which would pull dark pixels down (compare Granados et
// al., CVPR 2010).
RadianceImage to_radiance(const Bracket& bracket, const Camera& camera, const RadianceOptions& options = {});

}  // namespace lampglow::photometry
