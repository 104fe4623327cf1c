#include "estimator/inference/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace lampglow::inference {
namespace {

constexpr double kFirstNodeRad = 2e-4;
constexpr double kLastNodeRad = 1.45;
constexpr double kDegree = std::numbers::pi / 180.0;

std::vector<double> log_nodes(double first, double last, size_t count) {
  std::vector<double> nodes(count);
  const double step = std::log(last / first) / static_cast<double>(count - 1);
  for (size_t n = 0; n < count; ++n) nodes[n] = first * std::exp(step * static_cast<double>(n));
  return nodes;
}

struct Between {
  size_t node;
  double fraction;
};

Between locate(std::span<const double> nodes, double theta) {
  static const double per_node = (kSceneNodes - 1) / std::log(kLastNodeRad / kFirstNodeRad);
  const double position =
      std::clamp(std::log(theta / nodes[0]) * per_node, 0.0, static_cast<double>(nodes.size()) - 1.0001);
  const auto node = static_cast<size_t>(position);
  return {node, position - static_cast<double>(node)};
}

// Adds the weights with which node values make the value at theta: θ·f is interpolated, which a halo's 1/θ
// makes flat.
void add_weight(std::span<const double> nodes, double theta, double weight, std::span<double> weights) {
  theta = std::max(theta, nodes[0]);
  const Between at = locate(nodes, theta);
  weights[at.node] += weight * (1.0 - at.fraction) * nodes[at.node] / theta;
  weights[at.node + 1] += weight * at.fraction * nodes[at.node + 1] / theta;
}

}  // namespace

std::span<const double> scene_nodes_rad() {
  static const std::vector<double> nodes = log_nodes(kFirstNodeRad, kLastNodeRad, kSceneNodes);
  return nodes;
}

SkyPosition sky_position(const photometry::Ring& ring, const Camera& camera) {
  return {2.0 * ring.mean_x_px / camera.width_px - 1.0,
          (2.0 * ring.mean_y_px - camera.height_px) / camera.width_px};
}

double spread_density(const PointSpread& spread, double theta_rad) {
  const auto& x = spread.theta_rad;
  const auto& y = spread.ln_density;
  const double theta = std::max(theta_rad, x.front());
  size_t n = 0;
  while (n + 2 < x.size() && x[n + 1] < theta) ++n;
  const double fraction = std::log(theta / x[n]) / std::log(x[n + 1] / x[n]);
  return std::exp(y[n] + fraction * (y[n + 1] - y[n]));
}

Scene::Scene(const Camera& camera, std::vector<SceneLamp> lamps, const PointSpread& spread,
             const photometry::RingMap& map)
    : scale_(camera),
      lamps_(std::move(lamps)),
      spread_(spread),
      ring_shapes_(std::make_shared<const std::vector<photometry::Ring>>(map.rings)),
      rings_(map.rings.size()) {
  for (const SceneLamp& lamp : lamps_) add_geometry(lamp);
  axis_pixel_sr_ = 1.0 / (scale_.focal_length_px * scale_.focal_length_px);
  core_area_px_ = std::numbers::pi * map.edges_rad[1] * map.edges_rad[1] / axis_pixel_sr_;
  for (const auto& ring : map.rings) {
    owner_.push_back(ring.lamp);
    is_core_.push_back(ring.theta_low_rad == 0);
    const SkyPosition position = sky_position(ring, camera);
    ring_x_.push_back(position.x);
    ring_y_.push_back(position.y);
  }
  for (const double theta : scene_nodes_rad())
    emission_shape_.push_back(std::clamp(std::log(theta / kDegree) / std::log(4.0), 0.0, 1.5));
  for (size_t r = 0; r < rings_; ++r)
    for (size_t j = 0; j < lamps_.size(); ++j) {
      add_weights(r, j, ranges_);
      direct_.push_back(direct_share(r, j));
    }
  make_convolution();
}

Scene Scene::with_guests(std::span<const SceneLamp> guests) const {
  Scene scene = *this;
  const size_t own = lamps_.size();
  scene.ranges_.clear();
  scene.direct_.clear();
  for (const SceneLamp& guest : guests) {
    scene.lamps_.push_back(guest);
    scene.add_geometry(guest);
  }
  for (size_t r = 0; r < rings_; ++r)
    for (size_t j = 0; j < scene.lamps_.size(); ++j) {
      if (j < own) {
        scene.ranges_.push_back(ranges_[r * own + j]);
        scene.direct_.push_back(direct_[r * own + j]);
        continue;
      }
      scene.add_weights(r, j, scene.ranges_);
      scene.direct_.push_back(scene.direct_share(r, j));
    }
  return scene;
}

Scene Scene::with_strengths(std::span<const double> ln_change) const {
  Scene scene = *this;
  for (size_t j = 0; j < ln_change.size(); ++j) scene.lamps_[j].ln_strength += ln_change[j];
  return scene;
}

Scene Scene::with_halos(std::span<const double> ln_change) const {
  Scene scene = *this;
  for (size_t j = 0; j < ln_change.size(); ++j) scene.lamps_[j].ln_halo += ln_change[j];
  return scene;
}

void Scene::add_geometry(const SceneLamp& lamp) {
  solid_angle_.push_back(scale_.pixel_solid_angle_sr(lamp.x_px, lamp.y_px));
  to_lamp_.push_back(scale_.direction(lamp.x_px, lamp.y_px));
}

// The ring's sample points that the frame's picture has: those under a guest's mask are not.
std::vector<photometry::Direction> Scene::open_samples(size_t ring, size_t lamp) const {
  std::vector<photometry::Direction> open = (*ring_shapes_)[ring].samples;
  if (lamps_[lamp].masked_rad > 0)
    std::erase_if(open, [&](const photometry::Direction& sample) {
      return photometry::plane_distance(sample, to_lamp_[lamp]) < lamps_[lamp].masked_rad;
    });
  return open;
}

void Scene::add_weights(size_t ring, size_t lamp, std::vector<Range>& ranges) {
  std::array<double, kSceneNodes> row{};
  const auto samples = open_samples(ring, lamp);
  const double weight = samples.empty() ? 0 : 1.0 / static_cast<double>(samples.size());
  for (const auto& sample : samples)
    add_weight(scene_nodes_rad(), photometry::angle_rad(sample, to_lamp_[lamp]), weight, row);
  size_t first = 0, last = kSceneNodes;
  while (first < kSceneNodes && row[first] == 0) ++first;
  while (last > first && row[last - 1] == 0) --last;
  ranges.push_back({static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(last - first),
                    static_cast<std::uint32_t>(weights_.size())});
  weights_.insert(weights_.end(), row.begin() + static_cast<std::ptrdiff_t>(first),
                  row.begin() + static_cast<std::ptrdiff_t>(last));
}

// Halo (x) point spread on the nodes, flat-sky: the core leaves the halo as it is, the wings are integrated
// in polar co-ordinates round the target. The density is per pixel, so areas are counted in pixels.
void Scene::make_convolution() {
  constexpr int kRadii = 40, kTurns = 24;
  convolution_.assign(kSceneNodes * kSceneNodes, 0.0);
  const double last = spread_.theta_rad.back();
  const double ratio = std::pow(last / spread_.core_theta_rad, 1.0 / kRadii);
  std::vector<double> row(kSceneNodes);
  for (size_t m = 0; m < kSceneNodes; ++m) {
    std::fill(row.begin(), row.end(), 0.0);
    row[m] += spread_.core_fraction;
    for (int r = 0; r < kRadii; ++r) {
      const double low = spread_.core_theta_rad * std::pow(ratio, r), high = low * ratio;
      const double radius = std::sqrt(low * high);
      const double share = spread_density(spread_, radius) * std::numbers::pi * (high * high - low * low) /
                           axis_pixel_sr_ / kTurns;
      for (int t = 0; t < kTurns; ++t) {
        const double turn = 2.0 * std::numbers::pi * (t + 0.5) / kTurns;
        const double theta =
            std::hypot(scene_nodes_rad()[m] + radius * std::cos(turn), radius * std::sin(turn));
        if (theta < kLastNodeRad) add_weight(scene_nodes_rad(), theta, share, row);
      }
    }
    for (size_t n = 0; n < kSceneNodes; ++n) convolution_[n * kSceneNodes + m] = row[n];
  }
}

// Part of the lamp's light that each pixel of the ring gets straight through the lens.
double Scene::direct_share(size_t ring, size_t lamp) const {
  if (owner_[ring] == static_cast<int>(lamp) && is_core_[ring]) return spread_.core_fraction / core_area_px_;
  const auto samples = open_samples(ring, lamp);
  double sum = 0;
  for (const auto& sample : samples)
    sum += spread_density(spread_, photometry::plane_distance(sample, to_lamp_[lamp]));
  return samples.empty() ? 0 : sum / static_cast<double>(samples.size());
}

double Scene::average(size_t ring, size_t lamp, std::span<const double> at_nodes) const {
  const Range& range = ranges_[ring * lamps_.size() + lamp];
  double sum = 0;
  for (size_t n = 0; n < range.count; ++n) sum += weights_[range.offset + n] * at_nodes[range.start + n];
  return sum;
}

}  // namespace lampglow::inference
