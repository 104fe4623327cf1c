#include "estimator/inference/window.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lampglow::inference {
namespace {

using photometry::RadianceImage;

constexpr int kStep_px = 2;                       // differences over twice this
constexpr int kSkyNear_px = 9, kSkyFar_px = 18;   // above the box
constexpr int kBodyBelow_px = 4;                  // the box's edge: its upper rows show some sky
constexpr double kNoiseOfDifference = 4.0 / 9.0;  // of two differences of means of 9, over a pixel's variance

double mean3x3(const RadianceImage& image, int x, int y) {
  double sum = 0;
  for (int j = -1; j <= 1; ++j)
    for (int i = -1; i <= 1; ++i) sum += image.radiance.at(x + i, y + j);
  return sum / 9;
}

double square(double x) {
  return x * x;
}

double mean_radiance(const RadianceImage& image, int left, int top, int right, int bottom) {
  double sum = 0;
  int n = 0;
  for (int y = std::max(top, 0); y < std::min(bottom, image.radiance.height_px); ++y)
    for (int x = std::max(left, 0); x < std::min(right, image.radiance.width_px); ++x) {
      if (image.mask.at(x, y) & (photometry::kHot | photometry::kInvalid)) continue;
      sum += image.radiance.at(x, y), ++n;
    }
  return n > 0 ? sum / n : 0.0;
}

// Sharp energy of one column, and noise's part in it, between two rows.
struct Energy {
  double sharp = 0, noise = 0;
};

Energy column_energy(const RadianceImage& image, int x, int top, int bottom) {
  Energy energy;
  int n = 0;
  for (int y = top; y < bottom; ++y) {
    if (image.mask.at(x, y) & (photometry::kHot | photometry::kInvalid)) continue;
    energy.sharp += square(mean3x3(image, x + kStep_px, y) - mean3x3(image, x - kStep_px, y)) +
                    square(mean3x3(image, x, y + kStep_px) - mean3x3(image, x, y - kStep_px));
    const double v = image.variance.at(x, y);
    if (std::isfinite(v)) energy.noise += kNoiseOfDifference * v;
    ++n;
  }
  return n > 0 ? Energy{energy.sharp / n, energy.noise / n} : Energy{};
}

ColumnProfile profile_of(const RadianceImage& image, const Target& target) {
  constexpr int kReach_px = kStep_px + 1;
  const int left = static_cast<int>(target.x_px) - kMarginPx,
            right = static_cast<int>(target.x_px + target.width_px) + kMarginPx;
  const int box_top = static_cast<int>(target.y_px),
            box_bottom = static_cast<int>(target.y_px + target.height_px);
  const int top = std::max(box_top - kMarginPx, kReach_px),
            bottom = std::min(box_bottom + kMarginPx, image.radiance.height_px - kReach_px);
  ColumnProfile profile;
  if (box_top < kSkyFar_px) return profile;
  for (int column = left; column < right; ++column) {
    const int x = std::clamp(column, kReach_px, image.radiance.width_px - kReach_px - 1);
    const double sky = mean_radiance(image, x - 2, box_top - kSkyFar_px, x + 3, box_top - kSkyNear_px);
    if (sky <= 0) return {};
    const Energy energy = column_energy(image, x, top, bottom);
    profile.sharp.push_back((energy.sharp - energy.noise) / (sky * sky));
    profile.noise.push_back(energy.noise / (sky * sky));
    profile.contrast.push_back(1 - mean_radiance(image, x, box_top + kBodyBelow_px, x + 1, box_bottom) / sky);
  }
  return profile;
}

double mean_of(const std::vector<double>& values, int from, int count) {
  double sum = 0;
  for (int i = from; i < from + count; ++i) sum += values[static_cast<size_t>(i)];
  return sum / count;
}

double quantile(std::vector<double> values, double part) {
  const auto at = static_cast<std::ptrdiff_t>(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<size_t>(at)];
}

// What is left of a target's contrast in each strip, over the reference's.
struct Strips {
  std::vector<double> sharp, contrast;
  double noise = 0;   // the worst strip's, as a part of the reference's energy
  double spread = 0;  // variance of ln sharp
};

Strips compare(const ColumnProfile& now, const TargetClear& clear, int shift_px, int strip_px) {
  const int count = (static_cast<int>(now.sharp.size()) - 2 * kMarginPx) / strip_px;
  Strips strips;
  double sum = 0, squares = 0;
  for (int i = 0; i < count; ++i) {
    const int from = kMarginPx + i * strip_px;
    const double reference = std::max(mean_of(clear.sharp, from + shift_px, strip_px), 1e-12);
    const double left = std::sqrt(std::max(mean_of(now.sharp, from, strip_px) / reference, 1e-8));
    strips.sharp.push_back(left);
    strips.contrast.push_back(mean_of(now.contrast, from, strip_px) /
                              mean_of(clear.contrast, from + shift_px, strip_px));
    strips.noise = std::max(strips.noise, mean_of(now.noise, from, strip_px) / reference);
    sum += std::log(left), squares += square(std::log(left));
  }
  strips.spread = squares / count - square(sum / count);
  return strips;
}

// With the camera's sideways shift that makes the strips most alike.
Strips compare_shifted(const ColumnProfile& now, const TargetClear& clear, const WindowOptions& options) {
  Strips best;
  best.spread = std::numeric_limits<double>::infinity();
  for (int shift = -options.farthest_shift_px; shift <= options.farthest_shift_px; ++shift) {
    Strips strips = compare(now, clear, shift, options.strip_px);
    if (strips.spread < best.spread) best = std::move(strips);
  }
  return best;
}

bool comparable(const ColumnProfile& now, const TargetClear& clear, const WindowOptions& options) {
  constexpr int kLeastStrips = 3;
  const int columns = static_cast<int>(now.sharp.size()) - 2 * kMarginPx;
  return columns >= kLeastStrips * options.strip_px && clear.sharp.size() == now.sharp.size() &&
         *std::min_element(clear.contrast.begin(), clear.contrast.end()) > 0 &&
         mean_of(clear.contrast, kMarginPx, columns) >= options.least_contrast;
}

}  // namespace

std::vector<ColumnProfile> column_profiles(const RadianceImage& image, const std::vector<Target>& targets) {
  std::vector<ColumnProfile> profiles;
  profiles.reserve(targets.size());
  for (const Target& target : targets) profiles.push_back(profile_of(image, target));
  return profiles;
}

std::vector<TargetWindow> view_window(const std::vector<ColumnProfile>& now,
                                      const std::vector<Target>& targets, const WindowOptions& options) {
  std::vector<TargetWindow> window(targets.size());
  for (size_t t = 0; t < targets.size(); ++t) {
    if (!targets[t].clear || !comparable(now[t], *targets[t].clear, options)) continue;
    const Strips strips = compare_shifted(now[t], *targets[t].clear, options);
    const double sharp = quantile(strips.sharp, options.clearest);
    const double contrast = quantile(strips.contrast, options.clearest);
    if (sharp < options.least_seen || contrast <= 0 || strips.noise > options.most_noise * sharp * sharp)
      continue;
    window[t].strips = static_cast<int>(strips.sharp.size());
    // What fog leaves of the contrast is e^−τ.
    const double weaker = options.weaker * std::pow(std::min(contrast, 1.0), options.uneven_air);
    for (size_t i = 0; i < strips.sharp.size(); ++i)
      window[t].weaker += strips.sharp[i] < weaker * sharp && strips.contrast[i] < weaker * contrast;
  }
  return window;
}

bool rain_on_window(const std::vector<TargetWindow>& window, const WindowOptions& options) {
  int strips = 0, weaker = 0;
  for (const TargetWindow& target : window) strips += target.strips, weaker += target.weaker;
  return strips >= options.least_strips && weaker >= options.least_part * strips;
}

}  // namespace lampglow::inference
