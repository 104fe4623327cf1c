#include "estimator/photometry/ring_map.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

namespace lampglow::photometry {
namespace {

constexpr double kGuessedFieldOfViewRad = 40.0 * std::numbers::pi / 180.0;
constexpr int kSamplesPerRing = 48;

std::vector<double> ring_edges(const AngularScale& scale, const RingOptions& options) {
  std::vector<double> edges(static_cast<size_t>(options.rings) + 1, 0.0);
  const double first = options.core_radius_px / scale.focal_length_px;
  const double last = std::max(options.max_theta_deg * std::numbers::pi / 180.0, 4.0 * first);
  const double step = std::log(last / first) / (options.rings - 1);
  for (int k = 1; k <= options.rings; ++k) edges[static_cast<size_t>(k)] = first * std::exp(step * (k - 1));
  return edges;
}

// Ring of an angle; -1 beyond the last edge.
int ring_of_angle(double theta, const std::vector<double>& edges) {
  if (theta >= edges.back()) return -1;
  if (theta < edges[1]) return 0;
  const double step = std::log(edges[2] / edges[1]);
  const int last = static_cast<int>(edges.size()) - 2;
  return std::clamp(1 + static_cast<int>(std::floor(std::log(theta / edges[1]) / step)), 1, last);
}

struct Owner {
  int lamp = -1;
  double theta = 0;
};

// The lamp with the greatest strength over angle squared.
Owner owner_of(const Direction& ray, std::span<const Direction> lamps, std::span<const RingCentre> centres) {
  Owner best;
  double best_value = 0;
  for (size_t i = 0; i < lamps.size(); ++i) {
    const double dx = ray.x - lamps[i].x, dy = ray.y - lamps[i].y, dz = ray.z - lamps[i].z;
    const double chord2 = std::max(dx * dx + dy * dy + dz * dz, 1e-12);
    const double value = centres[i].weight / chord2;
    if (value > best_value) {
      best_value = value;
      best = {static_cast<int>(i), 2.0 * std::asin(std::min(1.0, std::sqrt(chord2) / 2.0))};
    }
  }
  return best;
}

// Points of equal area in a full ring: for the steep inner rings, where pixels are coarse.
void sample_inner_ring(Ring& ring, const RingCentre& centre, const AngularScale& scale) {
  ring.samples.clear();
  const double low = ring.theta_low_rad * scale.focal_length_px,
               high = ring.theta_high_rad * scale.focal_length_px;
  for (int s = 0; s < kSamplesPerRing; ++s) {
    const double area = (s + 0.5) / kSamplesPerRing;
    const double radius = std::sqrt(low * low + area * (high * high - low * low));
    const double turn = 2.0 * std::numbers::pi * s * 0.6180339887498949;
    ring.samples.push_back(
        scale.direction(centre.x_px + radius * std::cos(turn), centre.y_px + radius * std::sin(turn)));
  }
  ring.mean_x_px = centre.x_px;
  ring.mean_y_px = centre.y_px;
}

void find_runs(RingMap& map) {
  const Image<RingIndex>& rings = map.ring_of_pixel;
  map.first_run.push_back(0);
  for (int row = 0; row < rings.height_px; ++row) {
    for (int column = 0, next = 0; column < rings.width_px; column = next) {
      const RingIndex ring = rings.at(column, row);
      for (next = column + 1; next < rings.width_px && rings.at(next, row) == ring;) ++next;
      if (ring >= 0) map.runs.push_back({ring, column, next - 1});
    }
    map.first_run.push_back(map.runs.size());
  }
}

// A few of the ring's own pixels, evenly strided: they carry the shape of what the neighbours left of it.
void sample_outer_rings(RingMap& map, const AngularScale& scale) {
  std::vector<int> count(map.rings.size(), 0), seen(map.rings.size(), 0);
  std::vector<double> sum_x(map.rings.size(), 0), sum_y(map.rings.size(), 0);
  for (const RingIndex ring : map.ring_of_pixel.pixels)
    if (ring >= 0) ++count[static_cast<size_t>(ring)];
  for (int row = 0; row < map.ring_of_pixel.height_px; ++row)
    for (int column = 0; column < map.ring_of_pixel.width_px; ++column) {
      const RingIndex index = map.ring_of_pixel.at(column, row);
      if (index < 0) continue;
      const auto r = static_cast<size_t>(index);
      sum_x[r] += column + 0.5;
      sum_y[r] += row + 0.5;
      const std::int64_t n = seen[r]++;
      const bool keep = n * kSamplesPerRing / count[r] != (n + 1) * kSamplesPerRing / count[r];
      if (keep) map.rings[r].samples.push_back(scale.direction(column + 0.5, row + 0.5));
    }
  for (size_t r = 0; r < map.rings.size(); ++r) {
    if (count[r] == 0) continue;
    map.rings[r].mean_x_px = sum_x[r] / count[r];
    map.rings[r].mean_y_px = sum_y[r] / count[r];
  }
}

bool is_sky(const RingOptions& options, int column, int row) {
  if (static_cast<size_t>(column) >= options.skyline_px.size()) return true;
  const int skyline = options.skyline_px[static_cast<size_t>(column)];
  return skyline < 0 || row < skyline - options.skyline_margin_px;
}

}  // namespace

AngularScale::AngularScale(const Camera& camera)
    : focal_length_px(
          camera.focal_length_px.value_or(camera.width_px / 2.0 / std::tan(kGuessedFieldOfViewRad / 2))),
      principal_x_px(camera.principal_x_px),
      principal_y_px(camera.principal_y_px),
      known(camera.focal_length_px.has_value()) {}

Direction AngularScale::direction(double x_px, double y_px) const {
  const double x = (x_px - principal_x_px) / focal_length_px, y = (y_px - principal_y_px) / focal_length_px;
  const double norm = 1.0 / std::sqrt(1.0 + x * x + y * y);
  return {x * norm, y * norm, norm};
}

double AngularScale::pixel_solid_angle_sr(double x_px, double y_px) const {
  const double cosine = direction(x_px, y_px).z;
  return cosine * cosine * cosine / (focal_length_px * focal_length_px);
}

double angle_rad(const Direction& a, const Direction& b) {
  return 2.0 * std::asin(std::min(1.0, std::hypot(a.x - b.x, a.y - b.y, a.z - b.z) / 2.0));
}

double plane_distance(const Direction& a, const Direction& b) {
  return std::hypot(a.x / a.z - b.x / b.z, a.y / a.z - b.y / b.z);
}

RingMap make_ring_map(const Camera& camera, std::span<const RingCentre> centres, const RingOptions& options) {
  if (centres.size() * static_cast<size_t>(options.rings) > kMaxRings)
    throw std::invalid_argument(std::to_string(centres.size()) + " lamps of " +
                                std::to_string(options.rings) + " rings each: expected at most " +
                                std::to_string(kMaxRings) + " rings");
  const AngularScale scale(camera);
  RingMap map;
  map.options = options;
  map.centres.assign(centres.begin(), centres.end());
  map.edges_rad = ring_edges(scale, options);
  map.inner_zone_rad = 3.0 * options.core_radius_px / scale.focal_length_px;
  std::vector<Direction> lamps;
  for (const RingCentre& c : centres) lamps.push_back(scale.direction(c.x_px, c.y_px));
  for (size_t i = 0; i < centres.size(); ++i)
    for (size_t k = 0; k < static_cast<size_t>(options.rings); ++k) {
      const double low = map.edges_rad[k], high = map.edges_rad[k + 1];
      map.rings.push_back({static_cast<int>(i),
                           low,
                           high,
                           2.0 / 3.0 * (high * high * high - low * low * low) / (high * high - low * low),
                           {},
                           centres[i].x_px,
                           centres[i].y_px});
    }
  map.ring_of_pixel = Image<RingIndex>(camera.width_px, camera.height_px, -1);
  for (int row = 0; row < camera.height_px; ++row)
    for (int column = 0; column < camera.width_px; ++column) {
      const Owner owner = owner_of(scale.direction(column + 0.5, row + 0.5), lamps, centres);
      if (owner.lamp < 0 || (owner.theta > map.inner_zone_rad && !is_sky(options, column, row))) continue;
      const int k = ring_of_angle(owner.theta, map.edges_rad);
      if (k >= 0) map.ring_of_pixel.at(column, row) = static_cast<RingIndex>(owner.lamp * options.rings + k);
    }
  find_runs(map);
  sample_outer_rings(map, scale);
  for (Ring& ring : map.rings)
    if (ring.theta_high_rad <= map.inner_zone_rad)
      sample_inner_ring(ring, map.centres[static_cast<size_t>(ring.lamp)], scale);
  return map;
}

}  // namespace lampglow::photometry
