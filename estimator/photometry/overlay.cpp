#include "estimator/photometry/overlay.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

namespace lampglow::photometry {
namespace {

struct RowLook {
  int median_dn = 0;
  bool flat_black = false;  // most pixels are black, to a step or two
};

RowLook look_at_row(const Image<std::uint16_t>& pixels, int row, double black_dn, double step_dn) {
  std::vector<std::uint16_t> dn(&pixels.at(0, row), &pixels.at(0, row) + pixels.width_px);
  const auto middle = dn.begin() + static_cast<std::ptrdiff_t>(dn.size() / 2);
  std::nth_element(dn.begin(), middle, dn.end());
  RowLook look;
  look.median_dn = *middle;
  const auto same = std::count_if(dn.begin(), dn.end(),
                                  [&](std::uint16_t value) { return value <= black_dn + 6.5 * step_dn; });
  look.flat_black = look.median_dn <= black_dn + 4.5 * step_dn && same * 2 > pixels.width_px;
  return look;
}

// Rows of the band that begins at `edge` and goes inwards.
int band(const Image<std::uint16_t>& pixels, int edge, int direction, double black_dn, double step_dn) {
  const int most = pixels.height_px / 10;
  int rows = 0;
  while (rows <= most && look_at_row(pixels, edge + direction * rows, black_dn, step_dn).flat_black) ++rows;
  if (rows == 0 || rows > most) return 0;
  // The jump: the second and third row after the band are both clearly brighter.
  for (const int beyond : {1, 2}) {
    const RowLook look = look_at_row(pixels, edge + direction * (rows + beyond), black_dn, step_dn);
    if (look.median_dn < black_dn + 12 * step_dn) return 0;
  }
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
