#include "estimator/photometry/hot_pixels.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>

#include "estimator/photometry/vectorized.h"

namespace lampglow::photometry {
namespace {

// The full test for a pixel that already stands out of its row.
bool is_hot(const Image<float>& radiance, const Image<float>& variance, int column, int row,
            const HotPixelOptions& options) {
  // Surroundings: the ring of 16 pixels two away, which a lamp's core hardly reaches.
  std::array<float, 16> ring{};
  size_t count = 0;
  for (int dy = -2; dy <= 2; ++dy)
    for (int dx = -2; dx <= 2; ++dx)
      if (std::max(std::abs(dx), std::abs(dy)) == 2 && radiance.contains(column + dx, row + dy))
        ring[count++] = radiance.at(column + dx, row + dy);
  const auto middle = ring.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(ring.begin(), middle, ring.begin() + static_cast<std::ptrdiff_t>(count));
  const double rise = radiance.at(column, row) - *middle;
  const double sigma = std::sqrt(variance.at(column, row));
  if (!(rise > options.threshold_sigma * sigma)) return false;

  double sum = 0, highest = 0;
  int beside = 0;
  for (int dy = -1; dy <= 1; ++dy) {
    for (int dx = -1; dx <= 1; ++dx) {
      if ((dx == 0 && dy == 0) || !radiance.contains(column + dx, row + dy)) continue;
      const double neighbour = radiance.at(column + dx, row + dy) - *middle;
      highest = std::max(highest, neighbour - 3 * std::sqrt(variance.at(column + dx, row + dy)));
      if (dx != 0 && dy != 0) continue;
      sum += neighbour;
      ++beside;
    }
  }
  return sum < options.neighbour_part * rise * beside && highest < 0.4 * rise;
}

// Quick test of a row's inner pixels: above both neighbours by the threshold. It leaves a handful; false:
// none.
LAMPGLOW_VECTORIZED bool find_standing_out(std::span<const float> value, const float* variance,
                                           float threshold, std::uint8_t* stands_out) {
  unsigned any = 0;
  for (size_t x = 1; x + 1 < value.size(); ++x) {
    const float rise = value[x] - std::max(value[x - 1], value[x + 1]);
    const std::uint8_t out = (rise > 0.0F) & (rise * rise * 2.0F > threshold * variance[x]);
    stands_out[x] = out;
    any |= out;
  }
  return any != 0;
}

}  // namespace

std::vector<PixelIndex> find_hot_pixels(const Image<float>& radiance, const Image<float>& variance,
                                        const HotPixelOptions& options) {
  std::vector<PixelIndex> found;
  const int width = radiance.width_px;
  const auto threshold = static_cast<float>(options.threshold_sigma * options.threshold_sigma);
  std::vector<std::uint8_t> stands_out(static_cast<size_t>(std::max(width, 0)));
  if (width < 3) return found;
  for (int row = 0; row < radiance.height_px; ++row) {
    if (!find_standing_out({&radiance.at(0, row), stands_out.size()}, &variance.at(0, row), threshold,
                           stands_out.data()))
      continue;
    for (int column = 1; column + 1 < width; ++column)
      if (stands_out[static_cast<size_t>(column)] && is_hot(radiance, variance, column, row, options))
        found.push_back({column, row});
  }
  return found;
}

void HotPixelLearner::add(const std::vector<PixelIndex>& found) {
  ++frames_;
  for (const PixelIndex& pixel : found) ++count_[pixel];
}

std::vector<PixelIndex> HotPixelLearner::map(double least_part) const {
  std::vector<PixelIndex> hot;
  for (const auto& [pixel, count] : count_)
    if (count >= 2 && count >= least_part * frames_) hot.push_back(pixel);
  return hot;
}

}  // namespace lampglow::photometry
