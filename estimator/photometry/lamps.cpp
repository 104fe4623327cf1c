#include "estimator/photometry/lamps.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace lampglow::photometry {
namespace {

// Wraps our pixels, no copy.
cv::Mat view(Image<float>& image) {
  return cv::Mat(image.height_px, image.width_px, CV_32F, image.pixels.data());
}

// The picture with `binning` x `binning` pixels averaged to one; masked pixels are left out of the mean.
RadianceImage binned(const RadianceImage& image, int binning) {
  RadianceImage small;
  small.saturation_radiance = image.saturation_radiance;
  const int width = image.radiance.width_px / binning, height = image.radiance.height_px / binning;
  small.radiance = Image<float>(width, height);
  small.variance = Image<float>(width, height);
  small.mask = Image<std::uint8_t>(width, height);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      float sum = 0, variance = 0, count = 0;
      std::uint8_t saturated = 0;
      for (int j = 0; j < binning; ++j) {
        for (int i = 0; i < binning; ++i) {
          const int column = x * binning + i, row = y * binning + j;
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
  }
  return small;
}

// The picture as signal to noise of a point source at each pixel: (I - background)/σ, matched with a
// Gaussian.
cv::Mat matched_filter(const RadianceImage& image, const DetectionOptions& options, double psf_sigma_px) {
  Background background =
      background_mesh(image, std::max(8, options.mesh_px / options.binning), options.mesh_samples);
  Image<float>& signal = background.level;  // reused
  const auto relative = static_cast<float>(options.relative_error);
  for (size_t i = 0; i < signal.pixels.size(); ++i) {
    const float level = signal.pixels[i], sigma = background.sigma.pixels[i];
    const float noise = std::sqrt(sigma * sigma + relative * relative * level * level) + 1e-30F;
    const bool masked = image.mask.pixels[i] & (kHot | kInvalid);
    signal.pixels[i] = masked ? 0.0F : (image.radiance.pixels[i] - level) / noise;
  }
  background.sigma = {};  // pictures are large
  cv::Mat smooth;
  cv::GaussianBlur(view(signal), smooth, cv::Size(0, 0), psf_sigma_px);
  smooth *= 2 * std::sqrt(3.141592653589793) * psf_sigma_px;  // 1/sqrt(Σ kernel²)
  return smooth;
}

// What a picture without noise of its own varies by, cell by cell.
Image<float> scatter_of(const cv::Mat& height, int cell_px, int samples) {
  RadianceImage image;
  image.radiance = Image<float>(height.cols, height.rows);
  image.variance = Image<float>(height.cols, height.rows);
  image.mask = Image<std::uint8_t>(height.cols, height.rows);
  height.copyTo(view(image.radiance));
  return background_mesh(image, cell_px, samples).sigma;
}

// Compression and structure make noise that is not white, and the matched filter's output is then rougher
// than 1: divides by the scatter that it really has, cell by cell, where that is more.
void normalise(cv::Mat& height, int cell_px, int samples) {
  Image<float> scatter = scatter_of(height, cell_px, samples);
  cv::Mat divisor = view(scatter);
  cv::max(divisor, 1.0F, divisor);
  height /= divisor;
}

struct Peak {
  int column, row;
  float height;
};

// Peaks of one patch whose prominence is enough: pixels are taken from the highest down and joined to what
// they touch; where two hills meet, the lower ends, and counts if it rises enough above that saddle.
class HillClimber {
 public:
  HillClimber(const cv::Mat& height, const DetectionOptions& options) : height_(height), options_(options) {
    hill_of_ = cv::Mat(height.size(), CV_32S, cv::Scalar(-1));
  }

  void climb(std::vector<cv::Point>& patch, std::vector<Peak>& peaks) {
    std::sort(patch.begin(), patch.end(), [this](cv::Point a, cv::Point b) {
      const float ha = height_.at<float>(a), hb = height_.at<float>(b);
      return ha != hb ? ha > hb : (a.y != b.y ? a.y < b.y : a.x < b.x);
    });
    hills_.clear();
    for (const cv::Point pixel : patch) add(pixel, peaks);
    for (size_t hill = 0; hill < hills_.size(); ++hill)
      if (root(static_cast<int>(hill)) == static_cast<int>(hill)) peaks.push_back(hills_[hill].peak);
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

  void add(cv::Point pixel, std::vector<Peak>& peaks) {
    const float height = height_.at<float>(pixel);
    int mine = -1;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const cv::Point next(pixel.x + dx, pixel.y + dy);
        if (next.x < 0 || next.y < 0 || next.x >= height_.cols || next.y >= height_.rows) continue;
        const int label = hill_of_.at<int>(next);
        if (label < 0) continue;
        const int other = root(label);
        mine = mine < 0 || mine == other ? other : join(mine, other, height, peaks);
      }
    }
    if (mine < 0) {
      mine = static_cast<int>(hills_.size());
      hills_.push_back({{pixel.x, pixel.y, height}, mine});
    }
    hill_of_.at<int>(pixel) = mine;
  }

  int join(int a, int b, float saddle, std::vector<Peak>& peaks) {
    Hill &first = hills_[static_cast<size_t>(a)], &second = hills_[static_cast<size_t>(b)];
    const bool first_higher = first.peak.height >= second.peak.height;
    Hill &high = first_higher ? first : second, &low = first_higher ? second : first;
    const double prominence = low.peak.height - saddle;
    if (prominence > options_.prominence_part * low.peak.height && prominence > options_.threshold_sigma)
      peaks.push_back(low.peak);
    low.parent = first_higher ? a : b;
    (void)high;
    return first_higher ? a : b;
  }

  const cv::Mat& height_;
  const DetectionOptions& options_;
  cv::Mat hill_of_;
  std::vector<Hill> hills_;
};

std::vector<Peak> find_peaks(const cv::Mat& height, const DetectionOptions& options) {
  cv::Mat labels;
  const int patches = cv::connectedComponents(height > options.threshold_sigma, labels, 8, CV_32S);
  std::vector<std::vector<cv::Point>> pixels(static_cast<size_t>(patches));
  for (int y = 0; y < labels.rows; ++y) {
    const int* label = labels.ptr<int>(y);
    for (int x = 0; x < labels.cols; ++x)
      if (label[x] > 0) pixels[static_cast<size_t>(label[x])].emplace_back(x, y);
  }
  std::vector<Peak> peaks;
  HillClimber climber(height, options);
  for (auto& patch : pixels) climber.climb(patch, peaks);
  return peaks;
}

}  // namespace

std::vector<DetectedLight> detect_lights(const RadianceImage& image, const DetectionOptions& options) {
  std::vector<DetectedLight> lights;
  if (image.empty()) return lights;
  const int binning = std::max(1, options.binning);
  // A pixel of 2x2 has the lamp's own spread and its own: σ² / 4 + 1/12 of the large pixel.
  const double psf =
      std::max(0.7, std::sqrt(options.psf_sigma_px * options.psf_sigma_px / (binning * binning)));
  cv::Mat height = binning > 1 ? matched_filter(binned(image, binning), options, psf)
                               : matched_filter(image, options, psf);
  normalise(height, std::max(16, 2 * options.mesh_px / binning), options.mesh_samples);
  std::vector<Peak> peaks = find_peaks(height, options);
  std::sort(peaks.begin(), peaks.end(), [](const Peak& a, const Peak& b) {
    // Equal heights in reading order: OpenCV's threads may number the patches in any.
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
