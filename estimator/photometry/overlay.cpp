#include "estimator/photometry/overlay.h"

#include <cstddef>
#include <cstdint>
#include <span>

#include "estimator/photometry/vectorized.h"

namespace lampglow::photometry {
namespace {

// Whether the median of a row is at most `limit_dn`.
LAMPGLOW_VECTORIZED bool mostly_up_to(std::span<const std::uint16_t> row, std::uint16_t limit_dn) {
  std::uint32_t count = 0;
  for (const std::uint16_t dn : row) count += dn <= limit_dn;
  return 2 * size_t{count} > row.size();
}

// Rows of the band that begins at `edge` and goes inwards.
int band(const Image<std::uint16_t>& pixels, int edge, int direction, double black_dn, double step_dn) {
  const int most = pixels.height_px / 10;
  const auto row_up_to = [&](int row, double steps) {
    const std::span<const std::uint16_t> dn(&pixels.at(0, row), static_cast<size_t>(pixels.width_px));
    return mostly_up_to(dn, static_cast<std::uint16_t>(black_dn + steps * step_dn));
  };
  int rows = 0;
  while (rows <= most && row_up_to(edge + direction * rows, 4.5)) ++rows;  // black, to a step or two
  if (rows == 0 || rows > most) return 0;
  // The jump: the second and third row after the band are both clearly brighter.
  for (const int beyond : {1, 2})
    if (row_up_to(edge + direction * (rows + beyond), 12)) return 0;
  return rows + 1;
}

}  // namespace

OverlayRows find_overlay(const Image<std::uint16_t>& pixels, const Camera& camera) {
  if (pixels.height_px < 40 || pixels.width_px < 40) return {};
  const double step_dn = (camera.saturation_dn - camera.black_level_dn) / 255;
  return {band(pixels, 0, 1, camera.black_level_dn, step_dn),
          band(pixels, pixels.height_px - 1, -1, camera.black_level_dn, step_dn)};
}

}  // namespace lampglow::photometry
