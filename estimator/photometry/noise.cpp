#include "estimator/photometry/noise.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

namespace lampglow::photometry {
namespace {

constexpr double kFullWellElectrons = 15000;  // a small sensor's, where nothing better is known
constexpr int kBlock = 8;
constexpr int kGroups = 16;
// Lower quartile of a block's variance over its expectation: 48 second differences, correlated by -2/3 and
// 1/6 at lags 1 and 2, have 24.7 degrees of freedom (Wilson and Hilferty).
constexpr double kLowerQuartile = 0.797;

struct Flatness {
  double mean;
  double variance;
};

// Mean and variance of one block; the variance from second differences along rows, which no slope disturbs.
Flatness block_statistics(const Exposure& exposure, std::span<const float> linear, int column, int row) {
  double sum = 0, squares = 0;
  for (int y = row; y < row + kBlock; ++y) {
    float x[kBlock];
    for (int i = 0; i < kBlock; ++i) {
      x[i] = linear[exposure.pixels.at(column + i, y)];
      sum += x[i];
    }
    for (int i = 1; i + 1 < kBlock; ++i) {
      const double second = 2.0 * x[i] - x[i - 1] - x[i + 1];
      squares += second * second;
    }
  }
  return {sum / (kBlock * kBlock), squares / (6.0 * kBlock * (kBlock - 2))};
}

// Up to about 2000 blocks spread over the picture, darkest first; blocks with clipped pixels are left out.
std::vector<Flatness> sample_blocks(const Exposure& exposure, const Camera& camera,
                                    std::span<const float> linear) {
  std::vector<Flatness> blocks;
  const int across = exposure.pixels.width_px / kBlock, down = exposure.pixels.height_px / kBlock;
  const int step = std::max(1, static_cast<int>(std::sqrt(across * down / 2000.0)));
  const double brightest = 0.9 * (camera.saturation_dn - camera.black_level_dn);
  for (int j = 0; j < down; j += step) {
    for (int i = 0; i < across; i += step) {
      const Flatness block = block_statistics(exposure, linear, i * kBlock, j * kBlock);
      if (block.mean < brightest && block.variance > 0) blocks.push_back(block);
    }
  }
  std::sort(blocks.begin(), blocks.end(), [](const Flatness& a, const Flatness& b) {
    return a.mean != b.mean ? a.mean < b.mean : a.variance < b.variance;
  });
  return blocks;
}

// One value per group of blocks of like brightness, darkest group first.
std::vector<Flatness> group_blocks(const std::vector<Flatness>& blocks) {
  std::vector<Flatness> groups;
  const size_t size = blocks.size() / kGroups;
  if (size < 4) return groups;
  for (size_t g = 0; g < kGroups; ++g) {
    std::vector<double> variance;
    double mean = 0;
    for (size_t i = g * size; i < (g + 1) * size; ++i) {
      variance.push_back(blocks[i].variance);
      mean += blocks[i].mean / static_cast<double>(size);
    }
    std::nth_element(variance.begin(), variance.begin() + static_cast<std::ptrdiff_t>(size / 4),
                     variance.end());
    groups.push_back({mean, variance[size / 4] / kLowerQuartile});
  }
  return groups;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double fitted_read_noise_dn(const std::vector<Flatness>& groups, const NoiseModel& noise, double lowest_dn) {
  std::vector<double> rest;
  for (size_t g = 0; g < groups.size() / 4; ++g)
    rest.push_back(groups[g].variance - noise.gain_dn_per_electron * std::max(groups[g].mean, 0.0));
  return std::sqrt(std::max(median(rest), lowest_dn * lowest_dn));
}

// Empty where too little of the picture is bright enough to tell shot noise from read noise.
std::optional<double> fitted_gain(const std::vector<Flatness>& groups, const NoiseModel& noise,
                                  double range) {
  std::vector<double> gains;
  for (const Flatness& group : groups)
    if (group.mean > 3 * std::max(groups.front().mean, 1e-4 * range) && group.mean > 0.01 * range)
      gains.push_back((group.variance - noise.read_noise_dn * noise.read_noise_dn) / group.mean);
  if (gains.size() < 3) return {};
  return median(gains);
}

}  // namespace

NoiseModel noise_model(const Exposure& exposure, const Camera& camera, std::span<const float> linear) {
  const double range = camera.saturation_dn - camera.black_level_dn;
  const double amplification = std::pow(10.0, exposure.gain_db.value_or(0) / 20);
  // JPEG's error at the usual qualities is about one step; only 8-bit pictures with a curve are JPEGs here.
  const bool lossy = camera.bit_depth == 8 && camera.response.kind != Response::Kind::linear;
  NoiseModel noise;
  noise.code_noise_dn = std::sqrt(1.0 / 12 + (lossy ? 1.0 : 0.0));
  noise.gain_dn_per_electron =
      camera.gain_dn_per_electron.value_or(range / kFullWellElectrons) * amplification;
  noise.read_noise_dn = camera.read_noise_dn.value_or(0) * std::max(1.0, amplification);
  noise.measured = !camera.gain_dn_per_electron || !camera.read_noise_dn;
  if (!noise.measured) return noise;

  const std::vector<Flatness> groups = group_blocks(sample_blocks(exposure, camera, linear));
  if (groups.empty()) {
    if (!camera.read_noise_dn) noise.read_noise_dn = 1e-3 * range;
    return noise;
  }
  // Each from the other in turn: the darkest quarter tells the read noise, what is well above it the gain.
  const double lowest_dn = 1e-4 * range, least_gain = 0.25 * noise.gain_dn_per_electron;
  for (int pass = 0; pass < 8; ++pass) {
    if (!camera.read_noise_dn) noise.read_noise_dn = fitted_read_noise_dn(groups, noise, lowest_dn);
    if (camera.gain_dn_per_electron) continue;
    if (const auto gain = fitted_gain(groups, noise, range))
      noise.gain_dn_per_electron = std::max(*gain, least_gain);
  }
  return noise;
}

}  // namespace lampglow::photometry
