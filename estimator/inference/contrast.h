// What one daylight frame shows of each target: how bright it is against the horizon sky, and how strongly
// its texture stands out. Ratios within the frame only, so that automatic exposure cancels.
#pragma once

#include <optional>
#include <vector>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::inference {

// A box of pixels, clipped to the picture.
struct PixelBox {
  int left = 0, top = 0, right = 0, bottom = 0;  // right and bottom exclusive
  bool empty() const { return right <= left || bottom <= top; }
};

PixelBox pixel_box(double x_px, double y_px, double width_px, double height_px, int picture_width_px,
                   int picture_height_px);

struct TargetView {
  // Brightness of the target's dark part over the horizon sky's at the same height; empty where there is no
  // sky above the box or it is saturated. One standard deviation of noise and of the sky's unevenness.
  std::optional<double> brightness_ratio;
  double brightness_ratio_sigma = 0;
  // How much brighter the dark part of the box's left half is than that of its right half, over the sky's
  // brightness: haze and light that are the same for both take nothing from it but contrast. Empty as above.
  std::optional<double> halves;
  double halves_sigma = 0;  // of noise and texture
  // Mean squared luminance gradient within the box, over the sky's brightness squared, per px²; noise
  // included, and the part of it that noise makes.
  double gradient_energy = 0;
  double noise_energy = 0;
};

struct DayView {
  std::vector<TargetView> targets;  // in the order of the targets asked for
  std::optional<double> sky;        // radiance of [day]'s sky box; empty without one
};

// `day` gives the sky box that gradients are measured against; without it each target's own sky serves.
DayView view_targets(const photometry::RadianceImage& image, const std::vector<Target>& targets,
                     const std::optional<DayCalibration>& day);

// Of all pixels, 0..1.
double saturated_part(const photometry::RadianceImage& image);

// Median radiance of the pixels of a box that show a picture; a saturated one counts as it is. Empty if
// fewer than a tenth of them do.
std::optional<double> median_radiance(const photometry::RadianceImage& image, const PixelBox& box);

}  // namespace lampglow::inference
