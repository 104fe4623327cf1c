#include "estimator/inference/contrast.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lampglow::inference {
namespace {

using photometry::RadianceImage;

constexpr int kNoiseCell_px = 32;        // cells for finding the frame's own noise
constexpr double kNoiseQuantile = 0.15;  // the flattest cells of a picture show noise alone
constexpr double kDarkQuantile = 0.3;    // of a box: target even if two thirds of the box are sky
constexpr int kSmooth_px = 2;            // brightness is averaged over 2·2+1 px squared before the quantile

bool is_picture(const RadianceImage& image, int x, int y) {
  return (image.mask.at(x, y) & (photometry::kHot | photometry::kInvalid)) == 0;
}

double quantile(std::vector<double>& values, double part) {
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<size_t>(at)];
}

// Sums over pixels for the gradient of a box: energy as seen, and as the noise model expects it of a flat
// scene. The central difference (b − a)/2 of two pixels of variance v each has variance v/2.
struct GradientSums {
  double energy = 0, expected_noise = 0;
  int pixels = 0;
  double mean_energy() const { return pixels > 0 ? energy / pixels : 0; }
  double mean_noise() const { return pixels > 0 ? expected_noise / pixels : 0; }
};

GradientSums gradient_sums(const RadianceImage& image, const PixelBox& box) {
  GradientSums sums;
  const auto& r = image.radiance;
  for (int y = std::max(box.top, 1); y < std::min(box.bottom, r.height_px - 1); ++y)
    for (int x = std::max(box.left, 1); x < std::min(box.right, r.width_px - 1); ++x) {
      if (!is_picture(image, x, y) || !is_picture(image, x - 1, y) || !is_picture(image, x + 1, y) ||
          !is_picture(image, x, y - 1) || !is_picture(image, x, y + 1))
        continue;
      const double gx = 0.5 * (r.at(x + 1, y) - r.at(x - 1, y)), gy = 0.5 * (r.at(x, y + 1) - r.at(x, y - 1));
      sums.energy += gx * gx + gy * gy;
      const double v = image.variance.at(x, y);
      if (std::isfinite(v)) sums.expected_noise += v;
      ++sums.pixels;
    }
  return sums;
}

// By how much the flattest cells' gradient energy differs from what the noise model expects: compression
// smooths some of the noise away, and its error is not independent from pixel to pixel.
double noise_scale(const RadianceImage& image) {
  std::vector<double> ratios;
  for (int y = 0; y + kNoiseCell_px <= image.radiance.height_px; y += kNoiseCell_px)
    for (int x = 0; x + kNoiseCell_px <= image.radiance.width_px; x += kNoiseCell_px) {
      const GradientSums sums = gradient_sums(image, {x, y, x + kNoiseCell_px, y + kNoiseCell_px});
      if (sums.mean_noise() > 0) ratios.push_back(sums.mean_energy() / sums.mean_noise());
    }
  return ratios.empty() ? 1.0 : quantile(ratios, kNoiseQuantile);
}

double smoothed(const RadianceImage& image, int x, int y) {
  double sum = 0;
  int n = 0;
  for (int j = std::max(y - kSmooth_px, 0); j <= std::min(y + kSmooth_px, image.radiance.height_px - 1); ++j)
    for (int i = std::max(x - kSmooth_px, 0); i <= std::min(x + kSmooth_px, image.radiance.width_px - 1); ++i)
      if (is_picture(image, i, j)) sum += image.radiance.at(i, j), ++n;
  return n > 0 ? sum / n : std::numeric_limits<double>::quiet_NaN();
}

std::vector<double> smoothed_pixels(const RadianceImage& image, const PixelBox& box) {
  std::vector<double> values;
  for (int y = box.top; y < box.bottom; ++y)
    for (int x = box.left; x < box.right; ++x) {
      const double value = smoothed(image, x, y);
      if (std::isfinite(value)) values.push_back(value);
    }
  return values;
}

// The sky above a box: brightness as a straight line over rows, with the scatter round it.
struct SkyLine {
  double at_bottom = 0;  // of the band, the row next to the box
  double slope = 0;      // per row, downwards
  double scatter = 0;    // of row medians round the line
  double saturated_part = 0;
};

std::optional<SkyLine> sky_above(const RadianceImage& image, const PixelBox& box) {
  const int height = std::clamp(box.bottom - box.top, 8, 60), margin = (box.right - box.left) / 4;
  // A gap keeps the target's own edge and its smoothing out of the band.
  const int bottom = box.top - kSmooth_px - 1, top = std::max(bottom - height, 0);
  const int left = std::max(box.left - margin, 0),
            right = std::min(box.right + margin, image.radiance.width_px);
  if (bottom - top < 4) return std::nullopt;
  std::vector<double> rows, medians;
  int saturated = 0, seen = 0;
  for (int y = top; y < bottom; ++y) {
    std::vector<double> values;
    for (int x = left; x < right; ++x) {
      if (!is_picture(image, x, y)) continue;
      values.push_back(image.radiance.at(x, y));
      saturated += (image.mask.at(x, y) & photometry::kSaturated) != 0;
      ++seen;
    }
    if (values.size() < 3) continue;
    rows.push_back(y - bottom);
    medians.push_back(quantile(values, 0.5));
  }
  if (rows.size() < 4) return std::nullopt;
  const double n = static_cast<double>(rows.size());
  double mean_row = 0, mean = 0, rr = 0, rm = 0;
  for (size_t i = 0; i < rows.size(); ++i) mean_row += rows[i] / n, mean += medians[i] / n;
  for (size_t i = 0; i < rows.size(); ++i)
    rr += (rows[i] - mean_row) * (rows[i] - mean_row), rm += (rows[i] - mean_row) * (medians[i] - mean);
  SkyLine sky;
  sky.slope = rm / rr;
  sky.at_bottom = mean - sky.slope * mean_row;
  for (size_t i = 0; i < rows.size(); ++i) {
    const double off = medians[i] - sky.at_bottom - sky.slope * rows[i];
    sky.scatter += off * off / n;
  }
  sky.scatter = std::sqrt(sky.scatter);
  sky.saturated_part = seen > 0 ? static_cast<double>(saturated) / seen : 1.0;
  return sky;
}

struct DarkPart {
  double brightness = 0, sigma = 0;
};

// The scatter of what lies around the quantile tells how well so many pixels determine it; neighbours that
// share a smoothing square are no two.
DarkPart dark_part(const RadianceImage& image, const PixelBox& box) {
  std::vector<double> values = smoothed_pixels(image, box);
  if (values.size() < 9) return {};
  constexpr double kSquare_px = (2 * kSmooth_px + 1) * (2 * kSmooth_px + 1);
  const double independent = std::max(1.0, static_cast<double>(values.size()) / kSquare_px);
  const double dark = quantile(values, kDarkQuantile);
  const double scatter = 0.5 * (quantile(values, 0.5) - quantile(values, 0.1));
  return {dark, 1.3 * scatter / std::sqrt(independent)};
}

void view_halves(const RadianceImage& image, const PixelBox& box, double sky, TargetView& view) {
  const int middle = (box.left + box.right) / 2;
  const DarkPart left = dark_part(image, {box.left, box.top, middle, box.bottom});
  const DarkPart right = dark_part(image, {middle, box.top, box.right, box.bottom});
  if (left.sigma <= 0 || right.sigma <= 0) return;
  view.halves = (left.brightness - right.brightness) / sky;
  view.halves_sigma = std::hypot(left.sigma, right.sigma) / sky;
}

// The dark quantile of noise alone lies below its mean; the sky's own dark quantile, taken the same way,
// tells by how much, so that a target lost in fog has a ratio of 1 and not less.
void view_brightness(const RadianceImage& image, const PixelBox& box, TargetView& view) {
  const std::optional<SkyLine> sky = sky_above(image, box);
  if (!sky || sky->at_bottom <= 0 || sky->saturated_part > 0.1) return;
  std::vector<double> target = smoothed_pixels(image, box);
  if (target.size() < 9) return;
  const int height = std::clamp(box.bottom - box.top, 8, 60);
  const PixelBox band{box.left, std::max(box.top - kSmooth_px - 1 - height, 0), box.right,
                      box.top - kSmooth_px - 1};
  std::vector<double> above;
  for (int y = band.top; y < band.bottom; ++y)
    for (int x = band.left; x < band.right; ++x) {
      const double value = smoothed(image, x, y);
      if (std::isfinite(value)) above.push_back(value - sky->slope * (y - band.bottom) - sky->at_bottom);
    }
  const double sky_dark = above.empty() ? 0.0 : quantile(above, kDarkQuantile);
  // The line is carried down half way to the box's middle: nearly the target's horizon, and safe.
  const double reach = 0.25 * (box.bottom - box.top);
  const double sky_there = sky->at_bottom + sky->slope * reach;
  if (sky_there <= 0) return;
  const double dark = quantile(target, kDarkQuantile);
  view.brightness_ratio = (dark - sky_dark) / sky_there;
  // The line's own error grows as it is carried on; a quarter of what it was carried by is allowed for.
  const double noise = sky->scatter / std::sqrt(static_cast<double>(height) / 3.0);
  view.brightness_ratio_sigma = std::hypot(noise, 0.25 * sky->slope * reach) / sky_there;
  view_halves(image, box, sky_there, view);
}

}  // namespace

PixelBox pixel_box(double x_px, double y_px, double width_px, double height_px, int picture_width_px,
                   int picture_height_px) {
  return {std::clamp(static_cast<int>(std::lround(x_px)), 0, picture_width_px),
          std::clamp(static_cast<int>(std::lround(y_px)), 0, picture_height_px),
          std::clamp(static_cast<int>(std::lround(x_px + width_px)), 0, picture_width_px),
          std::clamp(static_cast<int>(std::lround(y_px + height_px)), 0, picture_height_px)};
}

std::optional<double> median_radiance(const RadianceImage& image, const PixelBox& box) {
  std::vector<double> values;
  for (int y = box.top; y < box.bottom; ++y)
    for (int x = box.left; x < box.right; ++x)
      if (is_picture(image, x, y)) values.push_back(image.radiance.at(x, y));
  const double pixels = static_cast<double>(box.right - box.left) * (box.bottom - box.top);
  if (values.empty() || static_cast<double>(values.size()) < 0.1 * pixels) return std::nullopt;
  return quantile(values, 0.5);
}

double saturated_part(const RadianceImage& image) {
  const auto saturated =
      std::count_if(image.mask.pixels.begin(), image.mask.pixels.end(),
                    [](std::uint8_t bits) { return (bits & photometry::kSaturated) != 0; });
  return static_cast<double>(saturated) / static_cast<double>(image.mask.pixels.size());
}

DayView view_targets(const RadianceImage& image, const std::vector<Target>& targets,
                     const std::optional<DayCalibration>& day) {
  DayView view;
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  if (day)
    view.sky = median_radiance(
        image, pixel_box(day->sky_x_px, day->sky_y_px, day->sky_width_px, day->sky_height_px, width, height));
  const double scale = noise_scale(image);
  for (const Target& target : targets) {
    TargetView seen;
    const PixelBox box =
        pixel_box(target.x_px, target.y_px, target.width_px, target.height_px, width, height);
    // Learned contrast is measured against the one sky box; brightness only where a distance makes it useful.
    if (!target.contrast) view_brightness(image, box, seen);
    if (view.sky && *view.sky > 0) {
      const GradientSums sums = gradient_sums(image, box);
      seen.gradient_energy = sums.mean_energy() / (*view.sky * *view.sky);
      seen.noise_energy = scale * sums.mean_noise() / (*view.sky * *view.sky);
    }
    view.targets.push_back(seen);
  }
  return view;
}

}  // namespace lampglow::inference
