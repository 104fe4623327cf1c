// For a camera of which nothing is known: no angle of view, no exposure, no distances, no clear reference.
// Fog changes how bright each patch of the picture is against the one above it (by night halos spread upwards
// and the ground lights up; by day dark targets rise towards the sky: Koschmieder's ratio), and how strongly
// its texture stands out. `calibrate` learns from a period of known visibility how. An empirical method: it
// measures like what it has seen, and says nothing beyond that.
//
//   ln σ = b + Σ_i w_i z_i,   z_i = (f_i − mean_i) / scale_i
//
// f_i: ln((L_i + L_0) / (L_above + L_0)), L the mean linear brightness of a patch, L_0 a thousandth of the
// range; with texture also ln((G_i + 2 L_0) / (L_i + L_0)), G the root mean square of the differences over 4
// px in the picture averaged over 3x3 px. Gain and exposure cancel in both. Weights by ridge regression
// (Hoerl, Kennard 1970) of one fixed strength: on De Bilt's day the scores hardly change from a half to twice
// that.
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
  bool texture = false;  // by day; at night noise, raised by the camera's gain, passes for texture
  double ridge = 0.05;   // variance of what is no signal over that of the signal
  int least_frames = 16;
  double least_spread = 1.2;       // of ln σ between the frames, to learn anything from
  double least_correlation = 0.5;  // Spearman's, in cross-validation
  double block_s = 1800;           // frames within this long are left out together
  double farthest = 4.0;           // z is cut here: one patch (a car) must not carry the answer
  double strangest = 6.0;          // mean z² over the patches beyond which nothing is said
  double least_error = 0.2;  // of ln σ: a sensor's point and minutes are not the camera's path and moment
  double farthest_judged_m = 15e3;
};

// The f_i, row by row; textures after the steps of brightness.
std::vector<double> patch_features(const photometry::RadianceImage& image, const Camera& camera, int patch_px,
                                   bool texture);

struct PatchFrame {
  TimePoint time_utc{};
  std::vector<double> features;
  double ln_sigma = 0;  // the truth
};

struct PatchLearning {
  std::optional<PatchCalibration> calibration;  // empty: the data can't support it
  std::string why_not;
  int frames = 0;
  double rms_ln = 0, correlation = 0, fog_right = 0;  // all in cross-validation
  double median_abs_ln = 0;                           // of the frames up to farthest_judged_m
};

PatchLearning learn_patches(std::span<const PatchFrame> frames, const PatchOptions& options);

// Does [day_patches], does [night] speak of a picture taken at this altitude of the sun (unknown: of any)?
// Down to -8 deg a camera that is still in its colour mode sees by daylight; in the dark, or where it has
// changed to its monochrome night mode, [night] counts.
bool for_day_patches(std::optional<double> sun_altitude_deg, bool monochrome, const Site& site);
bool for_night_patches(std::optional<double> sun_altitude_deg, bool monochrome, const Site& site);

// Fills extinction, bounds or limit, weather, method and flags of `result`. The stranger the picture to what
// was learned from, the wider the bounds.
void measure_patches(const photometry::RadianceImage& image, const Camera& camera,
                     const PatchCalibration& calibration, std::optional<double> relative_humidity,
                     Method method, const PatchOptions& options, FrameResult& result);

}  // namespace lampglow::inference
