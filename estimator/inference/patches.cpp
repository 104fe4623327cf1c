#include "estimator/inference/patches.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "estimator/inference/weather.h"

namespace lampglow::inference {
namespace {

constexpr double kFloorPart = 1e-3;   // L_0 over the camera's range
constexpr double kLeastScale = 0.05;  // of ln L: patches that never change say nothing
constexpr double kFogMor_m = 1000;

struct Standard {
  std::vector<double> mean, scale;
};

Standard standard_of(std::span<const PatchFrame> frames, const std::vector<size_t>& use) {
  const size_t size = frames[use.front()].features.size();
  Standard s{std::vector<double>(size, 0.0), std::vector<double>(size, 0.0)};
  const auto n = static_cast<double>(use.size());
  for (const size_t f : use)
    for (size_t i = 0; i < size; ++i) s.mean[i] += frames[f].features[i] / n;
  for (const size_t f : use)
    for (size_t i = 0; i < size; ++i) s.scale[i] += std::pow(frames[f].features[i] - s.mean[i], 2) / n;
  for (double& v : s.scale) v = std::sqrt(v) + kLeastScale;
  return s;
}

Eigen::VectorXd standardised(const std::vector<double>& features, const Standard& s, double farthest) {
  Eigen::VectorXd z(static_cast<Eigen::Index>(features.size()));
  for (size_t i = 0; i < features.size(); ++i)
    z[static_cast<Eigen::Index>(i)] = std::clamp((features[i] - s.mean[i]) / s.scale[i], -farthest, farthest);
  return z;
}

struct Ridge {
  Standard standard;
  Eigen::VectorXd weight;
  double intercept = 0;
};

// In the dual form: there are more patches than frames.
Ridge fit_ridge(std::span<const PatchFrame> frames, const std::vector<size_t>& use, double ridge,
                double farthest) {
  Ridge model;
  model.standard = standard_of(frames, use);
  const auto n = static_cast<Eigen::Index>(use.size());
  const auto size = static_cast<Eigen::Index>(frames[use.front()].features.size());
  Eigen::MatrixXd z(n, size);
  Eigen::VectorXd y(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const PatchFrame& frame = frames[use[static_cast<size_t>(k)]];
    z.row(k) = standardised(frame.features, model.standard, farthest).transpose();
    y[k] = frame.ln_sigma;
  }
  model.intercept = y.mean();
  Eigen::MatrixXd kernel = z * z.transpose() / static_cast<double>(size);
  kernel.diagonal().array() += ridge;
  const Eigen::VectorXd dual = kernel.ldlt().solve((y.array() - model.intercept).matrix());
  model.weight = z.transpose() * dual / static_cast<double>(size);
  return model;
}

std::vector<double> ranks(const std::vector<double>& values) {
  std::vector<size_t> order(values.size());
  std::iota(order.begin(), order.end(), size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) { return values[a] < values[b]; });
  std::vector<double> rank(values.size());
  for (size_t i = 0; i < order.size(); ++i) rank[order[i]] = static_cast<double>(i);
  return rank;
}

double spearman(const std::vector<double>& a, const std::vector<double>& b) {
  const std::vector<double> x = ranks(a), y = ranks(b);
  const double mean = (static_cast<double>(a.size()) - 1) / 2;
  double xy = 0, xx = 0, yy = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    xy += (x[i] - mean) * (y[i] - mean);
    xx += (x[i] - mean) * (x[i] - mean);
    yy += (y[i] - mean) * (y[i] - mean);
  }
  return xx > 0 && yy > 0 ? xy / std::sqrt(xx * yy) : 0;
}

// Blocks of time, so that a frame is never judged by its neighbours.
std::vector<int> blocks_of(std::span<const PatchFrame> frames, double block_s) {
  std::vector<int> blocks;
  int block = -1;
  TimePoint start{};
  for (const PatchFrame& frame : frames) {
    const double since = std::chrono::duration<double>(frame.time_utc - start).count();
    if (block < 0 || since >= block_s) ++block, start = frame.time_utc;
    blocks.push_back(block);
  }
  return blocks;
}

std::vector<double> cross_validated(std::span<const PatchFrame> frames, const std::vector<int>& blocks,
                                    double ridge, double farthest) {
  std::vector<double> predicted(frames.size(), 0.0);
  for (int block = 0; block <= blocks.back(); ++block) {
    std::vector<size_t> use;
    for (size_t f = 0; f < frames.size(); ++f)
      if (blocks[f] != block) use.push_back(f);
    const Ridge model = fit_ridge(frames, use, ridge, farthest);
    for (size_t f = 0; f < frames.size(); ++f)
      if (blocks[f] == block)
        predicted[f] =
            model.intercept + standardised(frames[f].features, model.standard, farthest).dot(model.weight);
  }
  return predicted;
}

double rms_of(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]) * (a[i] - b[i]);
  return std::sqrt(sum / static_cast<double>(a.size()));
}

// ln(L + L_0) of every patch, row by row.
std::vector<double> ln_brightness(const photometry::RadianceImage& image, int columns, int rows, int patch_px,
                                  double floor) {
  std::vector<double> result;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      double sum = 0;
      int count = 0;
      for (int y = row * patch_px; y < (row + 1) * patch_px; ++y)
        for (int x = column * patch_px; x < (column + 1) * patch_px; ++x) {
          if (image.mask.at(x, y) & (photometry::kHot | photometry::kInvalid)) continue;
          sum += image.radiance.at(x, y);
          ++count;
        }
      result.push_back(std::log(std::max(count > 0 ? sum / count : 0.0, 0.0) + floor));
    }
  return result;
}

// The picture averaged over 3x3 px; the outermost pixels stay 0.
std::vector<float> averaged(const photometry::RadianceImage& image) {
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  std::vector<float> result(static_cast<size_t>(width) * static_cast<size_t>(height), 0.0F);
  for (int y = 1; y + 1 < height; ++y)
    for (int x = 1; x + 1 < width; ++x) {
      double sum = 0;
      for (int j = -1; j <= 1; ++j)
        for (int i = -1; i <= 1; ++i) sum += image.radiance.at(x + i, y + j);
      result[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)] =
          static_cast<float>(sum / 9);
    }
  return result;
}

// ln(G + 2 L_0) of every patch, row by row.
std::vector<double> ln_roughness(const photometry::RadianceImage& image, int columns, int rows, int patch_px,
                                 double floor) {
  constexpr int kStep = 2, kEdge = kStep + 1;
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  const std::vector<float> smooth = averaged(image);
  const auto at = [&](int x, int y) {
    return static_cast<double>(
        smooth[static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)]);
  };
  std::vector<double> result;
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      double sum = 0;
      for (int y = std::max(row * patch_px, kEdge); y < std::min((row + 1) * patch_px, height - kEdge); ++y)
        for (int x = std::max(column * patch_px, kEdge); x < std::min((column + 1) * patch_px, width - kEdge);
             ++x)
          sum += std::pow(at(x + kStep, y) - at(x - kStep, y), 2) +
                 std::pow(at(x, y + kStep) - at(x, y - kStep), 2);
      result.push_back(std::log(std::sqrt(sum / (patch_px * patch_px)) + 2 * floor));
    }
  return result;
}

void fill_extinction(double ln_sigma, double sd, const PatchCalibration& calibration,
                     Observation& observation) {
  observation.extinction_per_m = std::exp(ln_sigma);
  observation.extinction_low_per_m = std::exp(ln_sigma - 1.96 * sd);
  observation.extinction_high_per_m = std::exp(ln_sigma + 1.96 * sd);
  // Far beyond what was learned from, only the side is known.
  if (ln_sigma < calibration.log_extinction_low - 2 * sd) {
    observation.limit = Limit::above;
    observation.quality.set(Quality::limit_above);
    observation.extinction_per_m = std::exp(calibration.log_extinction_low + 1.96 * sd);
    observation.extinction_high_per_m = observation.extinction_per_m;
    observation.extinction_low_per_m.reset();
  } else if (ln_sigma > calibration.log_extinction_high + 2 * sd) {
    observation.limit = Limit::below;
    observation.quality.set(Quality::limit_below);
    observation.extinction_per_m = std::exp(calibration.log_extinction_high - 1.96 * sd);
    observation.extinction_low_per_m = observation.extinction_per_m;
    observation.extinction_high_per_m.reset();
  }
}

void fill_weather(double sd, std::optional<double> relative_humidity, Observation& observation) {
  AirEstimate air;
  air.ln_sigma = std::log(*observation.extinction_per_m);
  air.ln_sigma_sd = sd;
  air.relative_humidity = relative_humidity;
  air.limit = observation.limit;
  observation.weather_probability = weather_probabilities(air);
  observation.weather = decide_weather(observation.weather_probability);
  observation.wmo_4680 =
      wmo_4680_now(observation.weather, kMorTimesExtinction / *observation.extinction_per_m);
  observation.relative_humidity = relative_humidity;
}

double median_abs(const std::vector<double>& predicted, std::span<const PatchFrame> frames,
                  double least_ln_sigma) {
  std::vector<double> off;
  for (size_t f = 0; f < frames.size(); ++f)
    if (frames[f].ln_sigma >= least_ln_sigma) off.push_back(std::abs(predicted[f] - frames[f].ln_sigma));
  if (off.empty()) return 0;
  const auto middle = off.begin() + static_cast<std::ptrdiff_t>(off.size() / 2);
  std::nth_element(off.begin(), middle, off.end());
  return *middle;
}

}  // namespace

std::vector<double> patch_features(const photometry::RadianceImage& image, const Camera& camera, int patch_px,
                                   bool texture) {
  const int columns = camera.width_px / patch_px, rows = camera.height_px / patch_px;
  const double floor = kFloorPart * std::max(image.saturation_radiance, 1e-9);
  const std::vector<double> bright = ln_brightness(image, columns, rows, patch_px, floor);
  std::vector<double> features;
  for (size_t i = static_cast<size_t>(columns); i < bright.size(); ++i)
    features.push_back(bright[i] - bright[i - static_cast<size_t>(columns)]);
  if (!texture) return features;
  const std::vector<double> rough = ln_roughness(image, columns, rows, patch_px, floor);
  for (size_t i = 0; i < bright.size(); ++i) features.push_back(rough[i] - bright[i]);
  return features;
}

bool for_day_patches(std::optional<double> altitude_deg, bool monochrome, const Site& site) {
  constexpr double kLight_deg = -8;
  return site.day_patches && (!altitude_deg || *altitude_deg > kLight_deg) &&
         !(site.day_patches->colour && monochrome);
}

bool for_night_patches(std::optional<double> altitude_deg, bool monochrome, const Site& site) {
  constexpr double kDark_deg = -9;
  const bool night_mode = site.day_patches && site.day_patches->colour && monochrome;
  return !altitude_deg || *altitude_deg < kDark_deg || (night_mode && *altitude_deg < 0);
}

PatchLearning learn_patches(std::span<const PatchFrame> frames, const PatchOptions& options) {
  PatchLearning learning;
  learning.frames = static_cast<int>(frames.size());
  if (learning.frames < options.least_frames) {
    learning.why_not = "only " + std::to_string(learning.frames) + " night frames have a truth; at least " +
                       std::to_string(options.least_frames) + " are needed";
    return learning;
  }
  std::vector<double> truth;
  for (const PatchFrame& frame : frames) truth.push_back(frame.ln_sigma);
  const auto [low, high] = std::minmax_element(truth.begin(), truth.end());
  const std::vector<int> blocks = blocks_of(frames, options.block_s);
  if (*high - *low < options.least_spread || blocks.back() < 2) {
    learning.why_not = "visibility hardly changed over the night frames, or they cover too short a time";
    return learning;
  }
  const std::vector<double> best = cross_validated(frames, blocks, options.ridge, options.farthest);
  learning.rms_ln = rms_of(best, truth);
  learning.correlation = spearman(best, truth);
  learning.median_abs_ln =
      median_abs(best, frames, std::log(kMorTimesExtinction / options.farthest_judged_m));
  const double fog = std::log(kMorTimesExtinction / kFogMor_m);
  for (size_t f = 0; f < truth.size(); ++f)
    learning.fog_right +=
        ((best[f] > fog) == (truth[f] > fog) ? 1.0 : 0.0) / static_cast<double>(truth.size());
  if (learning.correlation < options.least_correlation) {
    learning.why_not = "frames left out were not foretold: rank correlation below " +
                       std::to_string(options.least_correlation).substr(0, 4);
    return learning;
  }
  std::vector<size_t> all(frames.size());
  std::iota(all.begin(), all.end(), size_t{0});
  const Ridge model = fit_ridge(frames, all, options.ridge, options.farthest);
  PatchCalibration calibration;
  calibration.patch_px = options.patch_px;
  calibration.texture = options.texture;
  calibration.log_extinction_mean = model.intercept;
  calibration.log_extinction_sigma = std::max(learning.rms_ln, options.least_error);
  calibration.log_extinction_low = *low;
  calibration.log_extinction_high = *high;
  calibration.mean = model.standard.mean;
  calibration.scale = model.standard.scale;
  calibration.weight.assign(model.weight.data(), model.weight.data() + model.weight.size());
  learning.calibration = std::move(calibration);
  return learning;
}

void measure_patches(const photometry::RadianceImage& image, const Camera& camera,
                     const PatchCalibration& calibration, std::optional<double> relative_humidity,
                     Method method, const PatchOptions& options, FrameResult& result) {
  const std::vector<double> features =
      patch_features(image, camera, calibration.patch_px, calibration.texture);
  Observation& observation = result.observation;
  if (features.size() != calibration.weight.size()) {
    observation.quality.set(Quality::frame_wrong_size);
    result.reason = "the calibration of the picture's patches is of another picture size or an older version";
    return;
  }
  double ln_sigma = calibration.log_extinction_mean, strangeness = 0;
  for (size_t i = 0; i < features.size(); ++i) {
    const double z = std::clamp((features[i] - calibration.mean[i]) / calibration.scale[i], -options.farthest,
                                options.farthest);
    ln_sigma += calibration.weight[i] * z;
    strangeness += z * z / static_cast<double>(features.size());
  }
  if (strangeness > options.strangest) {
    result.reason = "the picture is unlike those that its patches' calibration was learned from";
    return;
  }
  result.reason.clear();
  observation.method = method;
  observation.quality.set(Quality::calibrated_distance);
  observation.quality.set(Quality::q_unknown);
  const double sd = calibration.log_extinction_sigma * std::sqrt(std::max(1.0, strangeness));
  fill_extinction(ln_sigma, sd, calibration, observation);
  fill_weather(sd, relative_humidity, observation);
}

}  // namespace lampglow::inference
