#include "estimator/scattering/camera_monte_carlo.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <string>

#include "estimator/scattering/phase_function.h"
#include "estimator/scattering/random.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;
// Paths end by roulette after some orders.
constexpr int kOrdersBeforeRoulette = 6;
constexpr double kSurvival = 0.9;
constexpr std::size_t kBatches = 20;

struct Vector {
  double x = 0, y = 0, z = 0;
};
Vector operator+(Vector a, Vector b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
Vector operator*(double s, Vector a) {
  return {s * a.x, s * a.y, s * a.z};
}
double dot(Vector a, Vector b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
Vector cross(Vector a, Vector b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Vector unit(Vector a) {
  return 1 / std::sqrt(dot(a, a)) * a;
}

// Three orthogonal directions; `axis` is given, `up` is as near to the given one as can be.
struct Frame {
  Vector axis, up, right;

  // The direction at an angle from the axis, turned from up to the right.
  Vector direction(double cosine, double azimuth) const {
    const double sine = std::sqrt(std::max(0.0, 1 - cosine * cosine));
    return cosine * axis + (sine * std::cos(azimuth)) * up + (sine * std::sin(azimuth)) * right;
  }
};

Frame frame_about(Vector axis, Vector up_hint) {
  const Vector right = unit(cross(axis, up_hint));
  return {axis, cross(right, axis), right};
}

Frame any_frame(Vector axis) {
  return frame_about(axis, std::abs(axis.z) < 0.9 ? Vector{0, 0, 1} : Vector{1, 0, 0});
}

[[noreturn]] void refuse(const std::string& what) {
  throw std::invalid_argument("camera Monte Carlo: " + what);
}

void check(const LampScene& scene, const CameraRays& rays) {
  check(scene.medium);
  if (!(scene.distance_m > 0)) refuse("distance_m must be positive");
  if (!(std::abs(scene.camera_below_deg) <= 80)) refuse("camera_below_deg must be within -80..80");
  if (!(scene.emission.opening_deg > 0 && scene.emission.opening_deg <= 360))
    refuse("opening_deg must be above 0 and at most 360");
  if (scene.ground) {
    const double height =
        scene.ground->lamp_height_m - scene.distance_m * std::sin(scene.camera_below_deg * kDegree);
    if (!(scene.ground->lamp_height_m > 0)) refuse("lamp_height_m must be positive");
    if (!(scene.ground->albedo >= 0 && scene.ground->albedo <= 1))
      refuse("ground albedo must be within 0..1");
    if (!(height > 0))
      refuse("the camera would be at " + std::to_string(height) +
             " m, below the ground: lower camera_below_deg");
  }
  const auto& edges = rays.theta_edges_rad;
  if (edges.size() < 2 || !(edges.front() >= 0) || !(edges.back() <= kPi) ||
      !std::is_sorted(edges.begin(), edges.end()))
    refuse("theta_edges_rad must be two or more ascending angles within 0..pi");
  if (rays.azimuth_bins == 0 || rays.paths_per_bin < kBatches)
    refuse("azimuth_bins must be positive and paths_per_bin at least 20");
}

// The lamp stands at the origin, z is up, the camera in the xz plane.
class Scene {
 public:
  explicit Scene(const LampScene& scene)
      : scene_(scene),
        extinction_(scene.medium.extinction_per_m),
        phase_(scene.medium.q),
        camera_(scene.distance_m * Vector{-std::cos(scene.camera_below_deg * kDegree), 0,
                                          -std::sin(scene.camera_below_deg * kDegree)}),
        view_(frame_about(-1 / scene.distance_m * camera_, {0, 0, 1})),
        // Seen from the lamp, right in the image is still view_.right.
        to_camera_{-1.0 * view_.axis, view_.up, view_.right},
        cone_axis_(to_camera_.direction(std::cos(scene.emission.axis_off_camera_deg * kDegree),
                                        scene.emission.axis_azimuth_deg * kDegree)) {}

  const Frame& view() const { return view_; }

  double direct_irradiance() const {
    const double intensity = scene_.emission.kind == LampEmission::Kind::sector
                                 ? 1 / (2 * scene_.emission.opening_deg * kDegree)
                                 : intensity_per_sr(to_camera_.axis);
    return intensity * std::exp(-extinction_ * scene_.distance_m) / (scene_.distance_m * scene_.distance_m);
  }

  // Radiance that comes to the camera against `direction`: one path. Every next vertex is drawn twice, by
  // nature's law and towards the lamp, and both count by the balance heuristic (Veach and Guibas 1995); the
  // path goes on from the first, so its weight stays as it is in nature.
  double radiance(Vector direction, Random& random, int max_orders) const {
    Place here{camera_, {}, Place::Kind::camera};
    double weight = 1, sum = 0;
    for (int order = 1;; ++order) {
      if (here.kind != Place::Kind::camera) {
        const Vector aimed =
            any_frame(unit(-1.0 * here.position)).direction(phase_.sample(random.uniform()), turn(random));
        sum += weight * aimed_light(here, aimed, random);
        direction = natural_direction(here, random);
      } else {
        sum += weight * aimed_light(here, direction, random);
      }
      const double ground_at = distance_to_ground(here.position, direction);
      const double distance = -std::log(random.open_uniform()) / extinction_;
      const bool ground = distance >= ground_at;
      const Place next{here.position + std::min(distance, ground_at) * direction, direction,
                       ground ? Place::Kind::ground : Place::Kind::air};
      weight *= ground ? scene_.ground->albedo : scene_.medium.albedo;
      sum += weight * (ground ? from_ground(next.position)
                              : natural_share(here, direction, distance, ground_at) *
                                    from_air(next.position, direction));
      if (order == max_orders || weight == 0) return sum;
      if (order > kOrdersBeforeRoulette) {
        if (random.uniform() > kSurvival) return sum;
        weight /= kSurvival;
      }
      here = next;
    }
  }

 private:
  // A vertex, and the direction of the ray that came to it (backward: away from the camera).
  struct Place {
    enum class Kind { camera, air, ground };
    Vector position, arrived;
    Kind kind = Kind::camera;
  };

  static double turn(Random& random) { return 2 * kPi * random.uniform(); }
  double ground_z() const { return -scene_.ground->lamp_height_m; }

  // Infinite if there is none.
  double distance_to_ground(Vector position, Vector direction) const {
    if (!scene_.ground || direction.z >= 0) return std::numeric_limits<double>::infinity();
    return std::max(0.0, (ground_z() - position.z) / direction.z);
  }

  Vector natural_direction(const Place& place, Random& random) const {
    if (place.kind == Place::Kind::ground)
      return any_frame({0, 0, 1}).direction(std::sqrt(random.uniform()), turn(random));
    return any_frame(place.arrived).direction(phase_.sample(random.uniform()), turn(random));
  }

  // Probability per sr of natural_direction(); 1 at the camera, whose direction is given.
  double natural_per_sr(const Place& place, Vector direction) const {
    if (place.kind == Place::Kind::camera) return 1;
    if (place.kind == Place::Kind::ground) return std::max(0.0, direction.z) / kPi;
    return phase_.per_sr(dot(place.arrived, direction));
  }

  double aimed_per_sr(const Place& place, Vector direction) const {
    if (place.kind == Place::Kind::camera) return 1;
    return phase_.per_sr(dot(unit(-1.0 * place.position), direction));
  }

  // The ray's course past the lamp: equal angles seen from the lamp are equally likely.
  struct Equiangular {
    double nearest, miss, begin, end;  // distance of the foot point; miss distance; angles
    double distance(double uniform) const {
      return nearest + miss * std::tan(begin + (end - begin) * uniform);
    }
    double per_m(double t) const {
      return miss / ((end - begin) * (miss * miss + (t - nearest) * (t - nearest)));
    }
  };

  static Equiangular equiangular(Vector position, Vector direction, double ground_at) {
    const double nearest = -dot(position, direction);
    const double miss = std::max(1e-6, std::sqrt(std::max(0.0, dot(position, position) - nearest * nearest)));
    return {nearest, miss, std::atan2(-nearest, miss),
            std::isinf(ground_at) ? kPi / 2 : std::atan2(ground_at - nearest, miss)};
  }

  // Nature's probability of this vertex over the sum of both laws'.
  double natural_share(const Place& from, Vector direction, double distance, double ground_at) const {
    const double natural = natural_per_sr(from, direction) * extinction_ * std::exp(-extinction_ * distance);
    const double aimed =
        aimed_per_sr(from, direction) * equiangular(from.position, direction, ground_at).per_m(distance);
    return natural / (natural + aimed);
  }

  // What a vertex drawn towards the lamp brings. Vertices on the ground come by nature's law alone.
  double aimed_light(const Place& from, Vector direction, Random& random) const {
    const double ground_at = distance_to_ground(from.position, direction);
    const double uniform = random.uniform();
    if (ground_at <= 0) return 0;
    const double distance = std::max(0.0, equiangular(from.position, direction, ground_at).distance(uniform));
    return scene_.medium.albedo * natural_share(from, direction, distance, ground_at) *
           from_air(from.position + distance * direction, direction);
  }

  // Light of the lamp that the vertex sends back along the ray, once its albedo is counted.
  double from_air(Vector position, Vector direction) const {
    const double squared = std::max(dot(position, position), 1e-12), distance = std::sqrt(squared);
    const Vector from_lamp = 1 / distance * position;
    // The light flies along from_lamp, then along -direction.
    return intensity_per_sr(from_lamp) * std::exp(-extinction_ * distance) / squared *
           phase_.per_sr(-dot(from_lamp, direction));
  }

  double from_ground(Vector position) const {
    const double squared = dot(position, position), distance = std::sqrt(squared);
    const Vector from_lamp = 1 / distance * position;
    return intensity_per_sr(from_lamp) * std::exp(-extinction_ * distance) / squared *
           std::max(0.0, -from_lamp.z) / kPi;
  }

  // Per unit flux.
  double intensity_per_sr(Vector direction) const {
    const LampEmission& lamp = scene_.emission;
    switch (lamp.kind) {
      case LampEmission::Kind::isotropic:
        return 1 / (4 * kPi);
      case LampEmission::Kind::lambertian_down:
        return std::max(0.0, -direction.z) / kPi;
      case LampEmission::Kind::cone: {
        const double cosine = std::cos(lamp.opening_deg / 2 * kDegree);
        return dot(direction, cone_axis_) >= cosine ? 1 / (2 * kPi * (1 - cosine)) : 0;
      }
      case LampEmission::Kind::sector: {
        const double azimuth = std::atan2(dot(direction, view_.right), dot(direction, view_.up));
        return std::abs(azimuth) <= lamp.opening_deg / 2 * kDegree ? 1 / (2 * lamp.opening_deg * kDegree) : 0;
      }
    }
    return 0;
  }

  const LampScene& scene_;
  double extinction_;
  HenyeyGreenstein phase_;
  Vector camera_;
  Frame view_, to_camera_;
  Vector cone_axis_;
};

// Mean over the bin's solid angle, from batches.
Estimate trace_bin(const Scene& scene, const CameraRays& rays, std::size_t bin) {
  const std::size_t ring = bin / rays.azimuth_bins, sector = bin % rays.azimuth_bins;
  const double inner = std::sin(rays.theta_edges_rad[ring] / 2),
               outer = std::sin(rays.theta_edges_rad[ring + 1] / 2);
  const double width = 2 * kPi / static_cast<double>(rays.azimuth_bins);
  Random random(rays.seed, bin);
  const std::uint64_t per_batch = (rays.paths_per_bin + kBatches - 1) / kBatches;
  std::vector<double> means(kBatches);
  for (double& mean : means) {
    for (std::uint64_t i = 0; i < per_batch; ++i) {
      // Even in solid angle: sin²(θ/2) is uniform.
      const double half_sine_squared = inner * inner + (outer * outer - inner * inner) * random.uniform();
      const double azimuth = (static_cast<double>(sector) + random.uniform() - 0.5) * width;
      const double cosine = 1 - 2 * half_sine_squared;
      const double sine = 2 * std::sqrt(half_sine_squared * (1 - half_sine_squared));
      const Frame& view = scene.view();
      const Vector direction =
          cosine * view.axis + (sine * std::cos(azimuth)) * view.up + (sine * std::sin(azimuth)) * view.right;
      mean += scene.radiance(direction, random, rays.max_orders);
    }
    mean /= static_cast<double>(per_batch);
  }
  double average = 0, squares = 0;
  for (const double mean : means) average += mean / static_cast<double>(kBatches);
  for (const double mean : means) squares += (mean - average) * (mean - average);
  return {average, std::sqrt(squares / static_cast<double>(kBatches * (kBatches - 1)))};
}

}  // namespace

RayRadiance simulate_camera(const LampScene& lamp_scene, const CameraRays& rays, const Executor& executor) {
  check(lamp_scene, rays);
  const Scene scene(lamp_scene);
  RayRadiance result;
  result.rings = rays.theta_edges_rad.size() - 1;
  result.sectors = rays.azimuth_bins;
  result.values.resize(result.rings * result.sectors);
  result.direct_irradiance = scene.direct_irradiance();
  executor(result.values.size(), [&](std::size_t bin) { result.values[bin] = trace_bin(scene, rays, bin); });
  return result;
}

}  // namespace lampglow::scattering
