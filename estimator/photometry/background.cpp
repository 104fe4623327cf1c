#include <algorithm>
#include <cmath>
#include <vector>

#include "estimator/photometry/lamps.h"
#include "estimator/photometry/median.h"

namespace lampglow::photometry {
namespace {

struct Cell {
  float level = 0;
  float sigma = 0;
  bool known = false;
};

// Median and scatter, clipped twice at 3 sigma; enough pixels must be usable.
Cell clipped_median(std::vector<float>& values, size_t least) {
  Cell cell;
  if (values.size() < least) return cell;
  std::vector<float> deviations(values.size());
  for (int pass = 0; pass < 3; ++pass) {
    cell.level = median_of(values);
    deviations.resize(values.size());
    std::transform(values.begin(), values.end(), deviations.begin(),
                   [&](float value) { return std::abs(value - cell.level); });
    cell.sigma = 1.4826F * median_of(deviations);
    const size_t before = values.size();
    std::erase_if(values, [&](float value) { return std::abs(value - cell.level) > 3 * cell.sigma; });
    if (values.size() == before || values.empty()) break;
  }
  cell.known = true;
  return cell;
}

Cell measure_cell(const RadianceImage& image, int left, int top, int mesh_px, int samples) {
  const int right = std::min(left + mesh_px, image.radiance.width_px);
  const int bottom = std::min(top + mesh_px, image.radiance.height_px);
  const int step = std::max(1, mesh_px / samples);
  std::vector<float> values;
  double variance = 0;
  for (int y = top + step / 2; y < bottom; y += step) {
    for (int x = left + step / 2; x < right; x += step) {
      if (image.mask.at(x, y) & ~kBloom) continue;
      values.push_back(image.radiance.at(x, y));
      variance += image.variance.at(x, y);
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
struct Between {
  int cell;
  float part;
};
std::vector<Between> between_cells(int size_px, int mesh_px, int cells) {
  std::vector<Between> table(static_cast<size_t>(size_px));
  for (int i = 0; i < size_px; ++i) {
    const float place = (static_cast<float>(i) + 0.5F) / static_cast<float>(mesh_px) - 0.5F;
    const float clamped = std::clamp(place, 0.0F, static_cast<float>(cells - 1));
    const int cell = std::min(static_cast<int>(clamped), std::max(cells - 2, 0));
    table[static_cast<size_t>(i)] = {cell, clamped - static_cast<float>(cell)};
  }
  return table;
}

}  // namespace

Background background_mesh(const RadianceImage& image, int mesh_px, int samples) {
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  const int across = (width + mesh_px - 1) / mesh_px, down = (height + mesh_px - 1) / mesh_px;
  std::vector<Cell> cells;
  for (int j = 0; j < down; ++j)
    for (int i = 0; i < across; ++i)
      cells.push_back(measure_cell(image, i * mesh_px, j * mesh_px, mesh_px, samples));
  cells = median_filter(cells, across, down);

  Background background{Image<float>(width, height), Image<float>(width, height)};
  const auto columns = between_cells(width, mesh_px, across), rows = between_cells(height, mesh_px, down);
  std::vector<float> level(static_cast<size_t>(across)), sigma(static_cast<size_t>(across));
  for (int y = 0; y < height; ++y) {
    const Between& row = rows[static_cast<size_t>(y)];
    for (int i = 0; i < across; ++i) {
      const Cell& above = cells[cell_index(i, row.cell, across)];
      const Cell& below = cells[cell_index(i, std::min(row.cell + 1, down - 1), across)];
      level[static_cast<size_t>(i)] = above.level + row.part * (below.level - above.level);
      sigma[static_cast<size_t>(i)] = above.sigma + row.part * (below.sigma - above.sigma);
    }
    for (int x = 0; x < width; ++x) {
      const Between& column = columns[static_cast<size_t>(x)];
      const auto i = static_cast<size_t>(column.cell),
                 next = static_cast<size_t>(std::min(column.cell + 1, across - 1));
      background.level.at(x, y) = level[i] + column.part * (level[next] - level[i]);
      background.sigma.at(x, y) = sigma[i] + column.part * (sigma[next] - sigma[i]);
    }
  }
  return background;
}

}  // namespace lampglow::photometry
