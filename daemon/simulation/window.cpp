#include "daemon/simulation/window.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "daemon/simulation/night.h"

namespace lampglow::simulation {

namespace {

constexpr double kPxPerMm = kFocalLengthPx / kWindowDistance_mm;  // on the window, as the picture's middle
constexpr double kWaterIndexLess1 = 0.33;
constexpr double kWaterTransmission = 0.96;  // one more surface
constexpr int kRays = 48;                    // through the aperture
constexpr int kEdgePx = 24;                  // the window around the picture that the aperture's rays reach

// How far in pixels the water at each place of the window turns a ray; nothing where it is dry.
struct WaterMap {
  Image<float> turn_x_px, turn_y_px;
  Image<std::uint8_t> wet;
};

// The surface is a paraboloid over the drop, and a cylinder of the same section along the streak: its slope
// grows evenly to the rim.
void add_drop(WaterMap& map, const Drop& drop) {
  const double radius = drop.radius_mm * kPxPerMm, streak = drop.streak_mm * kPxPerMm;
  const double x0 = kEdgePx + kWidthPx / 2.0 + drop.x_mm * kPxPerMm;
  const double y0 = kEdgePx + kHeightPx / 2.0 + drop.y_mm * kPxPerMm;
  const double turn_at_rim_px = kWaterIndexLess1 * drop.rim_slope * kFocalLengthPx;
  const int left = std::max(0, static_cast<int>(x0 - radius)), top = static_cast<int>(y0 - streak - radius);
  for (int y = std::max(0, top); y <= std::min(map.wet.height_px - 1, static_cast<int>(y0 + radius)); ++y) {
    for (int x = left; x <= std::min(map.wet.width_px - 1, static_cast<int>(x0 + radius)); ++x) {
      const double dx = x + 0.5 - x0;
      const double down = y + 0.5 - y0, dy = down - std::clamp(down, -streak, 0.0);
      if (dx * dx + dy * dy > radius * radius) continue;
      map.wet.at(x, y) = 1;
      map.turn_x_px.at(x, y) = static_cast<float>(-turn_at_rim_px * dx / radius);
      map.turn_y_px.at(x, y) = static_cast<float>(-turn_at_rim_px * dy / radius);
    }
  }
}

WaterMap map_of(const std::vector<Drop>& drops) {
  constexpr int kWidth = kWidthPx + 2 * kEdgePx, kHeight = kHeightPx + 2 * kEdgePx;
  WaterMap map{Image<float>(kWidth, kHeight), Image<float>(kWidth, kHeight),
               Image<std::uint8_t>(kWidth, kHeight)};
  for (const Drop& drop : drops) add_drop(map, drop);
  return map;
}

// Between four pixels; beyond the picture's edge the scene goes on as its edge is.
double between(const Image<double>& scene, double x_px, double y_px) {
  const double x = std::clamp(x_px - 0.5, 0.0, scene.width_px - 1.001);
  const double y = std::clamp(y_px - 0.5, 0.0, scene.height_px - 1.001);
  const int i = static_cast<int>(x), j = static_cast<int>(y);
  const double u = x - i, v = y - j;
  return (1 - v) * ((1 - u) * scene.at(i, j) + u * scene.at(i + 1, j)) +
         v * ((1 - u) * scene.at(i, j + 1) + u * scene.at(i + 1, j + 1));
}

struct Ray {
  int x_px = 0, y_px = 0;
};

// Where rays through the aperture meet the window, around the pixel's own: evenly over a disc (Vogel 1979).
std::vector<Ray> aperture_rays() {
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0)), radius_px = 0.5 * kAperture_mm * kPxPerMm;
  std::vector<Ray> rays;
  for (int i = 0; i < kRays; ++i) {
    const double r = radius_px * std::sqrt((i + 0.5) / kRays);
    rays.push_back({static_cast<int>(std::lround(r * std::cos(i * golden))),
                    static_cast<int>(std::lround(r * std::sin(i * golden)))});
  }
  return rays;
}

}  // namespace

double covered_part(const std::vector<Drop>& drops) {
  const WaterMap map = map_of(drops);
  double wet = 0;
  for (int y = 0; y < kHeightPx; ++y)
    for (int x = 0; x < kWidthPx; ++x) wet += map.wet.at(x + kEdgePx, y + kEdgePx);
  return wet / (static_cast<double>(kWidthPx) * kHeightPx);
}

Image<double> seen_through(const Image<double>& scene, const std::vector<Drop>& drops) {
  if (drops.empty()) return scene;
  const WaterMap map = map_of(drops);
  const std::vector<Ray> rays = aperture_rays();
  Image<double> seen(scene.width_px, scene.height_px);
  for (int y = 0; y < scene.height_px; ++y) {
    for (int x = 0; x < scene.width_px; ++x) {
      double sum = 0;
      for (const Ray& ray : rays) {
        const int i = x + kEdgePx + ray.x_px, j = y + kEdgePx + ray.y_px;
        if (map.wet.at(i, j) == 0)
          sum += scene.at(x, y);
        else
          sum += kWaterTransmission *
                 between(scene, x + 0.5 + map.turn_x_px.at(i, j), y + 0.5 + map.turn_y_px.at(i, j));
      }
      seen.at(x, y) = sum / kRays;
    }
  }
  return seen;
}

}  // namespace lampglow::simulation
