#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "estimator/photometry/lamps.h"
#include "estimator/photometry/median.h"
#include "estimator/photometry/vectorized.h"

namespace lampglow::photometry {
namespace {

struct Cell {
  float level = 0;
  float sigma = 0;
  bool known = false;
};

// Of sorted values, the median distance from `middle`, an element of them.
float median_distance(std::span<const float> sorted, float middle) {
  // The nearest are a stretch of them; it grows on the side that is nearer.
  auto low = std::lower_bound(sorted.begin(), sorted.end(), middle), high = low;
  const auto count = static_cast<std::ptrdiff_t>(sorted.size() / 2 + 1);
  float distance = 0;
  while (high - low < count) {
    const bool below =
        high == sorted.end() || (low != sorted.begin() && middle - *(low - 1) < *high - middle);
    distance = below ? middle - *--low : *high++ - middle;
  }
  return distance;
}

// Median and scatter, clipped twice at 3 sigma; enough pixels must be usable.
Cell clipped_median(std::vector<float>& values, size_t least) {
  Cell cell;
  if (values.size() < least) return cell;
  std::sort(values.begin(), values.end());
  std::span<const float> kept = values;
  for (int pass = 0; pass < 3; ++pass) {
    cell.level = kept[kept.size() / 2];
    cell.sigma = 1.4826F * median_distance(kept, cell.level);
    const size_t before = kept.size();
    while (kept.back() - cell.level > 3 * cell.sigma) kept = kept.first(kept.size() - 1);
    while (cell.level - kept.front() > 3 * cell.sigma) kept = kept.subspan(1);
    if (kept.size() == before) break;
  }
  cell.known = true;
  return cell;
}

Cell measure_cell(const RadianceView& image, int left, int top, int mesh_px, int samples) {
  const int right = std::min(left + mesh_px, image.radiance.width_px);
  const int bottom = std::min(top + mesh_px, image.radiance.height_px);
  const int step = std::max(1, mesh_px / samples);
  std::vector<float> values;
  const auto along_side = static_cast<size_t>(mesh_px / step + 1);
  values.reserve(along_side * along_side);
  double variance = 0;
  for (int y = top + step / 2; y < bottom; y += step) {
    for (int x = left + step / 2; x < right; x += step) {
      if (image.mask && (image.mask->at(x, y) & ~kBloom)) continue;
      values.push_back(image.radiance.at(x, y));
      if (image.variance) variance += image.variance->at(x, y);
    }
  }
  const size_t count = values.size();
  Cell cell = clipped_median(values, 16);
  // Integer-valued pictures may have a scatter of zero; the noise model knows better.
  if (cell.known)
    cell.sigma =
        std::max(cell.sigma, static_cast<float>(0.5 * std::sqrt(variance / static_cast<double>(count))));
  return cell;
}

// Of a mesh `across` cells wide, row by row.
size_t cell_index(int column, int row, int across) {
  return static_cast<size_t>(row) * static_cast<size_t>(across) + static_cast<size_t>(column);
}

// 3x3 median for the cells that need it: a cell filled by a lamp's glare is both brighter and more uneven
// than its neighbours, and takes their level. All others stay, so that slopes of the sky keep their shape up
// to the edge.
std::vector<Cell> median_filter(const std::vector<Cell>& cells, int across, int down) {
  std::vector<Cell> filtered(cells.size());
  for (int j = 0; j < down; ++j) {
    for (int i = 0; i < across; ++i) {
      std::vector<float> level, sigma;
      for (int reach = 1; level.empty() && reach < std::max(across, down) + 1; ++reach) {
        for (int y = std::max(0, j - reach); y <= std::min(down - 1, j + reach); ++y) {
          for (int x = std::max(0, i - reach); x <= std::min(across - 1, i + reach); ++x) {
            const Cell& cell = cells[cell_index(x, y, across)];
            if (!cell.known) continue;
            level.push_back(cell.level);
            sigma.push_back(cell.sigma);
          }
        }
      }
      if (level.empty()) continue;
      const Cell median{median_of(level), median_of(sigma), true};
      const Cell& cell = cells[cell_index(i, j, across)];
      const bool glare = cell.level > median.level + 3 * median.sigma && cell.sigma > 2 * median.sigma;
      filtered[cell_index(i, j, across)] = cell.known && !glare ? cell : median;
    }
  }
  return filtered;
}

// For each pixel along one side: the cell before it and the way to the next one, 0..1.
void between_cells(int size_px, int mesh_px, int cells, std::vector<std::int32_t>& cell,
                   std::vector<float>& part) {
  for (int i = 0; i < size_px; ++i) {
    const float place = (static_cast<float>(i) + 0.5F) / static_cast<float>(mesh_px) - 0.5F;
    const float clamped = std::clamp(place, 0.0F, static_cast<float>(cells - 1));
    cell.push_back(std::min(static_cast<int>(clamped), std::max(cells - 2, 0)));
    part.push_back(clamped - static_cast<float>(cell.back()));
  }
}

// Each pixel of a row between the levels of the cells' middles; `levels` has one more, the last one twice.
LAMPGLOW_VECTORIZED void interpolate(const float* levels, std::span<const std::int32_t> cell,
                                     const float* part, float* out) {
  for (size_t x = 0; x < cell.size(); ++x) {
    const float before = levels[cell[x]], after = levels[cell[x] + 1];
    out[x] = before + part[x] * (after - before);
  }
}

}  // namespace

Background::Background(const RadianceView& image, int mesh_px, int samples) {
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  const int across = (width + mesh_px - 1) / mesh_px, down = (height + mesh_px - 1) / mesh_px;
  std::vector<Cell> cells;
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i)
      cells.push_back(measure_cell(image, i * mesh_px, j * mesh_px, mesh_px, samples));
  cells = median_filter(cells, across, down);
  level_ = sigma_ = Image<float>(across, down);
  for (size_t i = 0; i < cells.size(); ++i) {
    level_.pixels[i] = cells[i].level;
    sigma_.pixels[i] = cells[i].sigma;
  }
  between_cells(width, mesh_px, across, column_cell_, column_part_);
  between_cells(height, mesh_px, down, row_cell_, row_part_);
}

void Background::levels_of_row(int row, std::span<float> level) const {
  row_of(level_, row, level);
}

void Background::sigmas_of_row(int row, std::span<float> sigma) const {
  row_of(sigma_, row, sigma);
}

void Background::row_of(const Image<float>& mesh, int row, std::span<float> out) const {
  const auto y = static_cast<size_t>(row);
  const int above = row_cell_[y], below = std::min(above + 1, mesh.height_px - 1);
  std::vector<float> between;
  between.reserve(static_cast<size_t>(mesh.width_px) + 1);
  for (int i = 0; i < mesh.width_px; ++i)
    between.push_back(mesh.at(i, above) + row_part_[y] * (mesh.at(i, below) - mesh.at(i, above)));
  between.push_back(between.back());
  interpolate(between.data(), column_cell_, column_part_.data(), out.data());
}

}  // namespace lampglow::photometry
