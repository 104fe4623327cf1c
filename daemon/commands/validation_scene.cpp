#include "daemon/commands/validation_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "daemon/config/base64.h"
#include "daemon/pictures/png.h"
#include "estimator/scattering/glow_renderer.h"
#include "estimator/scattering/medium.h"

namespace lampglow::daemon {
namespace {

constexpr int kSceneWidth = 480, kSceneHeight = 270;
constexpr std::size_t kScenePixels = std::size_t{kSceneWidth} * kSceneHeight;

std::size_t pixel(int column, int row) {
  return static_cast<std::size_t>(row) * kSceneWidth + static_cast<std::size_t>(column);
}

// Two rows of lamps along a road, nearer ones larger and brighter, a dim sky.
struct NightScene {
  std::vector<float> radiance = std::vector<float>(kScenePixels, 0.001f);
  std::vector<float> depth_m = std::vector<float>(kScenePixels, 400.0f);

  NightScene() {
    for (const double distance : {40.0, 60.0, 90.0, 140.0, 220.0, 350.0})
      for (const int side : {-1, 1}) {
        const double x = 0.5 * kSceneWidth + side * 7000 / distance,
                     y = kSceneHeight * 0.55 - 3500 / distance;
        const int size = distance < 80 ? 2 : 1;
        for (int dy = 0; dy < size; ++dy)
          for (int dx = 0; dx < size; ++dx)
            radiance[pixel(static_cast<int>(x) + dx, static_cast<int>(y) + dy)] =
                static_cast<float>(3e6 / (distance * distance) / (size * size));
      }
    // Each row of the picture has one distance, the road's: lamps hang at theirs.
    for (int row = 0; row < kSceneHeight; ++row) {
      const double below = kSceneHeight * 0.55 - row;
      const double distance = below > 0 ? std::clamp(3500 / below, 36.0, 400.0) : 400;
      std::fill_n(&depth_m[pixel(0, row)], kSceneWidth, static_cast<float>(distance));
    }
  }
};

std::string picture(const std::vector<float>& radiance, const std::string& caption) {
  std::vector<std::uint8_t> shown(kScenePixels);
  for (std::size_t i = 0; i < kScenePixels; ++i) {
    // Four decades, logarithmic: glow spans more than any screen.
    const float grey = 255 * (std::log10(std::max(radiance[i], 1e-6f)) + 2.3f) / 4;
    shown[i] = static_cast<std::uint8_t>(std::lrint(std::clamp(grey, 0.0f, 255.0f)));
  }
  const Bytes png = encode_png({{kSceneWidth, kSceneHeight, 1, 8}, std::span<const std::uint8_t>(shown)});
  return fmt::format(
      "<figure><img alt='{}' src='data:image/png;base64,{}'><figcaption>{}</figcaption></figure>\n", caption,
      base64(png), caption);
}

}  // namespace

std::string rendered_scene() {
  const NightScene scene;
  std::string html =
      "<h2>One scene, single and multiple scattering</h2>\n<p>Twelve even lamps at 40 to 350 m, q = 0.9, "
      "four "
      "decades of radiance on a logarithmic scale.</p>\n" +
      picture(scene.radiance, "clear");
  for (const double mor_m : {750.0, 150.0}) {
    html += "<div>";  // single beside multiple
    for (const bool single : {true, false}) {
      scattering::RenderOptions fog;
      fog.medium = {scattering::extinction_from_mor_per_m(mor_m), 1, 0.9};
      fog.focal_length_px = 600;
      fog.single_only = single;
      std::vector<float> out(scene.radiance.size());
      scattering::render_glow(scene.radiance, kSceneWidth, kSceneHeight, scene.depth_m, 0, fog, out);
      html += picture(out, fmt::format("{}, MOR {:.0f} m, {} scattering", mor_m > 500 ? "mild" : "dense",
                                       mor_m, single ? "single" : "multiple"));
    }
    html += "</div>\n";
  }
  return html;
}

}  // namespace lampglow::daemon
