// The night's fallback for a camera of which nothing is known: no angle of view, no exposure, no distances,
// no clear reference. Fog changes the brightness of the picture's patches (halos spread, far lights fade, the
// ground lights up); `calibrate` learns from a period of known visibility how. An empirical method: it
// measures like what it has seen, and says nothing beyond that.
//
//   ln σ = b + Σ_i w_i z_i,   z_i = (ln(L_i + L_0) − mean_i) / scale_i
//
// L_i: mean linear brightness of patch i, L_0 a thousandth of the range. Weights by ridge regression (Hoerl,
// Kennard 1970), its strength by cross-validation over blocks of time.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::inference {

struct PatchOptions {
  int patch_px = 32;
  int least_frames = 16;
  double least_spread = 1.2;       // of ln σ between the frames, to learn anything from
  double least_correlation = 0.5;  // Spearman's, in cross-validation
  double block_s = 1800;           // frames within this long are left out together
  double farthest = 4.0;           // z is cut here: one patch (a car) must not carry the answer
  double strangest = 6.0;          // mean z² over the patches beyond which nothing is said
};

// ln(L_i + L_0) for every patch, row by row.
std::vector<double> patch_features(const photometry::RadianceImage& image, const Camera& camera,
                                   int patch_px);

struct PatchFrame {
  TimePoint time_utc{};
  std::vector<double> features;
  double ln_sigma = 0;  // the truth
};

struct PatchLearning {
  std::optional<NightCalibration> calibration;  // empty: the data can't support it
  std::string why_not;
  int frames = 0;
  double rms_ln = 0, correlation = 0, fog_right = 0;  // all in cross-validation
};

PatchLearning learn_patches(std::span<const PatchFrame> frames, const PatchOptions& options);

// Fills extinction, bounds or limit, weather, method and flags of `result`.
void measure_patches(const photometry::RadianceImage& image, const Camera& camera,
                     const NightCalibration& calibration, std::optional<double> relative_humidity,
                     const PatchOptions& options, FrameResult& result);

}  // namespace lampglow::inference
