#include "estimator/photometry/lamps.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <span>
#include <vector>

#include "estimator/photometry/vectorized.h"

namespace lampglow::photometry {
namespace {

// Wraps our pixels, no copy.
cv::Mat view(Image<float>& image) {
  return cv::Mat(image.height_px, image.width_px, CV_32F, image.pixels.data());
}

// Adds a row's pixels, `binning` by `binning`, to those that they become; none of them is masked.
LAMPGLOW_VECTORIZED void add_pairs(const float* row, std::span<float> sums) {
  for (size_t x = 0; x < sums.size(); ++x) sums[x] += row[2 * x] + row[2 * x + 1];
}

// One large pixel, with masked pixels left out of its mean.
void bin_masked(const RadianceImage& image, int binning, int x, int y, RadianceImage& small) {
  float sum = 0, variance = 0, count = 0;
  std::uint8_t saturated = 0;
  for (int row = y * binning; row < (y + 1) * binning; ++row) {
    for (int column = x * binning; column < (x + 1) * binning; ++column) {
      const std::uint8_t mask = image.mask.at(column, row);
      if (mask & (kHot | kInvalid)) continue;
      sum += image.radiance.at(column, row);
      count += 1;
      if (mask & kSaturated)
        saturated = kSaturated;
      else
        variance += image.variance.at(column, row);
    }
  }
  small.mask.at(x, y) = count > 0 ? saturated : kInvalid;
  small.radiance.at(x, y) = count > 0 ? sum / count : 0;
  small.variance.at(x, y) = count > 0 ? variance / (count * count) : 0;
}

// The picture with `binning` x `binning` pixels averaged to one.
RadianceImage binned(const RadianceImage& image, int binning) {
  RadianceImage small;
  const int width = image.radiance.width_px / binning, height = image.radiance.height_px / binning;
  const auto length = static_cast<size_t>(width);
  small.radiance = Image<float>(width, height);
  small.variance = Image<float>(width, height);
  small.mask = Image<std::uint8_t>(width, height);
  for (int y = 0; y < height; ++y) {
    bool masked = binning != 2;
    for (int row = y * binning; row < (y + 1) * binning; ++row)
      masked = masked || any_masked({&image.mask.at(0, row), length * static_cast<size_t>(binning)});
    if (masked) {
      for (int x = 0; x < width; ++x) bin_masked(image, binning, x, y, small);
      continue;
    }
    const std::span<float> radiance(&small.radiance.at(0, y), length);
    const std::span<float> variance(&small.variance.at(0, y), length);
    for (const int row : {2 * y, 2 * y + 1}) {
      add_pairs(&image.radiance.at(0, row), radiance);
      add_pairs(&image.variance.at(0, row), variance);
    }
    for (float& value : radiance) value *= 1.0F / 4;
    for (float& value : variance) value *= 1.0F / 16;
  }
  return small;
}

// How far a row stands above its background, in its noise.
LAMPGLOW_VECTORIZED void above_background(std::span<const float> radiance, const std::uint8_t* mask,
                                          const float* level, const float* sigma, float relative,
                                          float* signal) {
  for (size_t x = 0; x < radiance.size(); ++x) {
    const float noise = std::sqrt(sigma[x] * sigma[x] + relative * relative * level[x] * level[x]) + 1e-30F;
    const float rise = (radiance[x] - level[x]) / noise;
    signal[x] = (mask[x] & (kHot | kInvalid)) != 0 ? 0.0F : rise;
  }
}

// The picture as signal to noise of a point source at each pixel: (I - background)/σ, matched with a
// Gaussian.
Image<float> matched_filter(const RadianceImage& image, const DetectionOptions& options,
                            double psf_sigma_px) {
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  const Background background({image.radiance, &image.variance, &image.mask},
                              std::max(8, options.mesh_px / options.binning), options.mesh_samples);
  Image<float> signal = Image<float>::unfilled(width, height), smooth = Image<float>::unfilled(width, height);
  const auto relative = static_cast<float>(options.relative_error);
  std::vector<float> level(static_cast<size_t>(width)), sigma(static_cast<size_t>(width));
  for (int row = 0; row < height; ++row) {
    background.levels_of_row(row, level);
    background.sigmas_of_row(row, sigma);
    above_background({&image.radiance.at(0, row), level.size()}, &image.mask.at(0, row), level.data(),
                     sigma.data(), relative, &signal.at(0, row));
  }
  cv::Mat out = view(smooth);
  cv::GaussianBlur(view(signal), out, cv::Size(0, 0), psf_sigma_px);
  out *= 2 * std::sqrt(3.141592653589793) * psf_sigma_px;  // 1/sqrt(Σ kernel²)
  return smooth;
}

LAMPGLOW_VECTORIZED void divide_by_roughness(std::span<float> row, const float* scatter) {
  for (size_t x = 0; x < row.size(); ++x) row[x] /= std::max(scatter[x], 1.0F);
}

// Compression and structure make noise that is not white, and the matched filter's output is then rougher
// than 1: divides by the scatter that it really has, cell by cell, where that is more.
void normalise(Image<float>& height, int cell_px, int samples) {
  const Background background({height}, cell_px, samples);
  std::vector<float> scatter(static_cast<size_t>(height.width_px));
  for (int row = 0; row < height.height_px; ++row) {
    background.sigmas_of_row(row, scatter);
    divide_by_roughness({&height.at(0, row), scatter.size()}, scatter.data());
  }
}

struct Peak {
  int column, row;
  float height;
};

// Peaks whose prominence is enough: pixels are taken from the highest down and joined to what they touch;
// where two hills meet, the lower ends, and counts if it rises enough above that saddle.
class HillClimber {
 public:
  HillClimber(const Image<float>& height, const DetectionOptions& options)
      : height_(height), options_(options), hill_of_(height.width_px, height.height_px, -1) {}

  std::vector<Peak> climb() {
    std::vector<PixelIndex> high;
    for (int row = 0; row < height_.height_px; ++row)
      for (int column = 0; column < height_.width_px; ++column)
        if (height_.at(column, row) > options_.threshold_sigma) high.push_back({column, row});
    std::sort(high.begin(), high.end(), [this](const PixelIndex& a, const PixelIndex& b) {
      const float ha = height_.at(a.column, a.row), hb = height_.at(b.column, b.row);
      return ha != hb ? ha > hb : (a.row != b.row ? a.row < b.row : a.column < b.column);
    });
    for (const PixelIndex& pixel : high) add(pixel);
    for (size_t hill = 0; hill < hills_.size(); ++hill)
      if (root(static_cast<int>(hill)) == static_cast<int>(hill)) peaks_.push_back(hills_[hill].peak);
    return std::move(peaks_);
  }

 private:
  struct Hill {
    Peak peak;
    int parent;
  };

  int root(int hill) {
    while (hills_[static_cast<size_t>(hill)].parent != hill) hill = hills_[static_cast<size_t>(hill)].parent;
    return hill;
  }

  void add(const PixelIndex& pixel) {
    const float height = height_.at(pixel.column, pixel.row);
    int mine = -1;
    for (int row = pixel.row - 1; row <= pixel.row + 1; ++row) {
      for (int column = pixel.column - 1; column <= pixel.column + 1; ++column) {
        if (!hill_of_.contains(column, row) || hill_of_.at(column, row) < 0) continue;
        const int other = root(hill_of_.at(column, row));
        mine = mine < 0 || mine == other ? other : join(mine, other, height);
      }
    }
    if (mine < 0) {
      mine = static_cast<int>(hills_.size());
      hills_.push_back({{pixel.column, pixel.row, height}, mine});
    }
    hill_of_.at(pixel.column, pixel.row) = mine;
  }

  int join(int a, int b, float saddle) {
    const bool first_higher =
        hills_[static_cast<size_t>(a)].peak.height >= hills_[static_cast<size_t>(b)].peak.height;
    const int high = first_higher ? a : b;
    Hill& low = hills_[static_cast<size_t>(first_higher ? b : a)];
    const double prominence = low.peak.height - saddle;
    if (prominence > options_.prominence_part * low.peak.height && prominence > options_.threshold_sigma)
      peaks_.push_back(low.peak);
    low.parent = high;
    return high;
  }

  const Image<float>& height_;
  const DetectionOptions& options_;
  Image<int> hill_of_;
  std::vector<Hill> hills_;
  std::vector<Peak> peaks_;
};

}  // namespace

std::vector<DetectedLight> detect_lights(const RadianceImage& image, const DetectionOptions& options) {
  std::vector<DetectedLight> lights;
  if (image.empty()) return lights;
  const int binning = std::max(1, options.binning);
  // A pixel of 2x2 has the lamp's own spread and its own: σ² / 4 + 1/12 of the large pixel.
  const double psf =
      std::max(0.7, std::sqrt(options.psf_sigma_px * options.psf_sigma_px / (binning * binning)));
  Image<float> height = binning > 1 ? matched_filter(binned(image, binning), options, psf)
                                    : matched_filter(image, options, psf);
  normalise(height, std::max(16, 2 * options.mesh_px / binning), options.mesh_samples);
  std::vector<Peak> peaks = HillClimber(height, options).climb();
  std::sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) {
    // Equal heights in reading order.
    return a.height != b.height ? a.height > b.height
                                : (a.row != b.row ? a.row < b.row : a.column < b.column);
  });

  CentroidOptions centroid;
  centroid.window_sigma_px = std::max(1.0, 1.25 * options.psf_sigma_px);
  for (const Peak& peak : peaks) {
    DetectedLight light =
        measure_light(image, (peak.column + 0.5) * binning, (peak.row + 0.5) * binning, centroid);
    if (light.snr < 0.5 * options.threshold_sigma || light.position_sigma_px > 1) continue;
    const bool compact = light.fwhm_px <= options.max_fwhm_px && light.elongation <= options.max_elongation;
    if (!compact && light.saturated_pixels == 0) continue;
    const bool known = std::any_of(lights.begin(), lights.end(), [&](const DetectedLight& other) {
      return std::hypot(other.x_px - light.x_px, other.y_px - light.y_px) < 1.5;
    });
    light.snr = peak.height;
    if (!known) lights.push_back(light);
  }
  std::stable_sort(lights.begin(), lights.end(),
                   [](const DetectedLight& a, const DetectedLight& b) { return a.flux > b.flux; });
  return lights;
}

}  // namespace lampglow::photometry
