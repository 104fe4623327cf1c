#include "daemon/commands/validation_visibility.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "daemon/commands/svg_plot.h"
#include "estimator/scattering/camera_monte_carlo.h"

namespace lampglow::daemon {
namespace {

using scattering::CameraRays;
using scattering::Executor;
using scattering::RayRadiance;
using Kind = scattering::LampEmission::Kind;

constexpr double kDegree = std::numbers::pi / 180;
constexpr double kQ = 0.9;
constexpr double kMild = 1.2, kDense = 4;                // T
constexpr double kOpenings[] = {315, 240, 180, 90, 30};  // the lecture's, in degrees

RayRadiance seen(Kind kind, double opening_deg, double thickness, const CameraRays& rays,
                 const Executor& executor) {
  scattering::LampScene scene;
  scene.distance_m = 100;
  scene.medium = {thickness / scene.distance_m, 1, kQ};
  scene.emission = {kind, opening_deg, 0, 0};
  return scattering::simulate_camera(scene, rays, executor);
}

CameraRays rays_of(const ValidationOptions& options) {
  CameraRays rays;
  rays.paths_per_bin = options.paths;
  rays.seed = options.seed;
  return rays;
}

// What a part of the lamp's light leaves of the whole's glow, both over the direct beam, in per cent with one
// standard deviation. Both are of the same paths, so it is the part that is left out which makes the error.
std::string share(const RayRadiance& part, const RayRadiance& whole, std::size_t bin) {
  const double unit = whole.values[bin].value / whole.direct_irradiance * part.direct_irradiance;
  const double left = part.values[bin].value / unit, sigma = part.values[bin].sigma / unit;
  const double sigma_whole = whole.values[bin].sigma / whole.values[bin].value;
  const double sigma_out = std::sqrt(std::max(0.0, sigma_whole * sigma_whole - sigma * sigma));
  const double error = std::hypot((1 - left) * sigma, left * sigma_out);
  return fmt::format("<td>{:.0f} ± {:.0f}</td>", 100 * left, std::max(1.0, std::ceil(100 * error)));
}

struct Profiles {
  std::string figure, table;
};

// Profiles over the direct beam, and what each opening leaves of the whole lamp's.
Profiles profiles(const ValidationOptions& options, Kind kind, double thickness, const Executor& executor) {
  CameraRays rays = rays_of(options);
  rays.theta_edges_rad = scattering::log_spaced_edges_rad(0.2, 20, 10);
  const RayRadiance whole = seen(Kind::isotropic, 360, thickness, rays, executor);
  std::vector<Line> lines;
  const auto add_line = [&](double opening_deg, const RayRadiance& glow) {
    Line line{fmt::format("{:.0f}°", opening_deg), {}, {}, Line::Style::line, lines.size()};
    for (std::size_t ring = 0; ring < glow.rings; ++ring) {
      line.x.push_back(std::sqrt(rays.theta_edges_rad[ring] * rays.theta_edges_rad[ring + 1]) / kDegree);
      line.y.push_back(glow.values[ring].value / glow.direct_irradiance);
    }
    lines.push_back(std::move(line));
  };
  add_line(360, whole);
  std::string table =
      fmt::format("<p>T = {}, in per cent of the whole lamp's:</p><table><tr><th>open</th>", thickness);
  for (const double theta_deg : lines.front().x) table += fmt::format("<th>{:.2g}°</th>", theta_deg);
  table += "</tr>\n";
  for (const double opening : kOpenings) {
    const RayRadiance part = seen(kind, opening, thickness, rays, executor);
    add_line(opening, part);
    table += fmt::format("<tr><td>{:.0f}°</td>", opening);
    for (std::size_t ring = 0; ring < part.rings; ++ring) table += share(part, whole, ring);
    table += "</tr>\n";
  }
  const char* what = kind == Kind::sector ? "Part hidden" : "Cone";
  return {svg_plot(fmt::format("{}, T = {}, q = {}", what, thickness, kQ), "angle from the lamp [deg]",
                   "radiance over direct irradiance [1/sr]", lines),
          table + "</table>\n"};
}

std::string mild_and_dense_profiles(const ValidationOptions& options, Kind kind, const Executor& executor) {
  const Profiles mild = profiles(options, kind, kMild, executor),
                 dense = profiles(options, kind, kDense, executor);
  return mild.figure + dense.figure + "<details><summary>Numbers</summary>" + mild.table + dense.table +
         "</details>\n";
}

// Where the light of a lamp with a hidden part is seen: the glow in twelve directions round it.
std::string round_the_lamp(const ValidationOptions& options, double thickness, const Executor& executor) {
  CameraRays rays = rays_of(options);
  rays.theta_edges_rad = {1.0 * kDegree, 2.0 * kDegree};
  rays.azimuth_bins = 12;
  std::string html = fmt::format(
      "<p>T = {}: the ring of 1° to 2°, glow relative to the whole lamp's at the same place, in per cent.</p>"
      "<table><tr><th>open</th>",
      thickness);
  for (std::size_t sector = 0; sector < rays.azimuth_bins; ++sector)
    html += fmt::format("<th>{}°</th>", sector * 360 / rays.azimuth_bins);
  html += "</tr>\n";
  const RayRadiance whole = seen(Kind::isotropic, 360, thickness, rays, executor);
  for (const double opening : kOpenings) {
    const RayRadiance part = seen(Kind::sector, opening, thickness, rays, executor);
    html += fmt::format("<tr><td>{:.0f}°</td>", opening);
    for (std::size_t sector = 0; sector < rays.azimuth_bins; ++sector) html += share(part, whole, sector);
    html += "</tr>\n";
  }
  return html + "</table>\n";
}

}  // namespace

std::string source_visibility(const ValidationOptions& options, const Executor& executor) {
  std::string html = fmt::format(
      "<h2>Source visibility</h2>\n<p>A part of the lamp is hidden, as the lecture has it: light leaves only "
      "into the sector of this opening, centred on straight up as the camera sees it; mean over whole rings. "
      "All have the same direct beam. Path-traced, {} paths a ring; ± one standard deviation.</p>\n",
      options.paths);
  html += mild_and_dense_profiles(options, Kind::sector, executor);
  html +=
      "<p>Round the lamp, clockwise from straight up: the glow sits where the light goes, in thick fog less "
      "so.</p>\n";
  for (const double thickness : {kMild, kDense}) html += round_the_lamp(options, thickness, executor);
  html +=
      "<p>The lamp's light leaves a cone about the line to the camera, of this full angle. All have the same "
      "direct beam; what a wide cone leaves out would hardly be seen: the fog scatters forward.</p>\n";
  return html + mild_and_dense_profiles(options, Kind::cone, executor);
}

}  // namespace lampglow::daemon
