#include "estimator/photometry/vignetting.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace lampglow::photometry {
namespace {

double half_diagonal_px(const Camera& camera) {
  return 0.5 * std::hypot(camera.width_px, camera.height_px);
}

}  // namespace

double vignetting_at(const Camera& camera, double rho) {
  double transmission = 0;
  for (auto v = camera.vignetting.rbegin(); v != camera.vignetting.rend(); ++v)
    transmission = (transmission + *v) * rho * rho;
  return 1 + transmission;
}

double farthest_rho(const Camera& camera) {
  const double x = std::max(camera.principal_x_px, camera.width_px - camera.principal_x_px);
  const double y = std::max(camera.principal_y_px, camera.height_px - camera.principal_y_px);
  return std::hypot(x, y) / half_diagonal_px(camera);
}

Image<float> vignetting_map(const Camera& camera) {
  Image<float> map(camera.width_px, camera.height_px);
  for (int row = 0; row < camera.height_px; ++row)
    for (int column = 0; column < camera.width_px; ++column) {
      const double rho = std::hypot(column + 0.5 - camera.principal_x_px, row + 0.5 - camera.principal_y_px) /
                         half_diagonal_px(camera);
      const double transmission = vignetting_at(camera, rho);
      if (!(transmission > 0))
        throw std::invalid_argument("vignetting: the transmission must be above 0 in the whole picture");
      map.at(column, row) = static_cast<float>(transmission);
    }
  return map;
}

}  // namespace lampglow::photometry
