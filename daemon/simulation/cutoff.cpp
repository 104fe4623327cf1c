#include "daemon/simulation/cutoff.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/scattering/camera_monte_carlo.h"

namespace lampglow::simulation {

namespace {

constexpr double kGroundAlbedo = 0.2;
constexpr double kUsualBelowDeg = 5;
constexpr int kSectors = 12;
constexpr size_t kRings = 22;
constexpr double kFirstDeg = 0.08;
constexpr double kLastDeg = 60;
constexpr std::uint64_t kPathsPerBin = 600;  // left and right are alike, so each value has twice as many

double below_deg(const Lamp& lamp) {
  return std::asin((lamp.height_m - kCameraHeight_m) / lamp.distance_m) * 180 / std::numbers::pi;
}

// The lamp is alike on its left and its right.
double symmetric(const scattering::RayRadiance& glow, size_t ring, int sector) {
  const auto mirror = static_cast<size_t>((kSectors - sector) % kSectors);
  return 0.5 * (glow.radiance(ring, static_cast<size_t>(sector)).value + glow.radiance(ring, mirror).value);
}

}  // namespace

double cutoff_intensity(const Lamp& lamp) {
  return std::sin(below_deg(lamp) * std::numbers::pi / 180) /
         std::sin(kUsualBelowDeg * std::numbers::pi / 180);
}

HaloProfile cutoff_halo(const Night& night, const Frame& frame, size_t lamp) {
  const Lamp& source = night.lamps[lamp];
  const double thickness = frame.extinction_per_m * source.distance_m;
  if (thickness > HaloLibrary::kThickest) return {};
  scattering::LampScene scene;
  scene.medium = {.extinction_per_m = frame.extinction_per_m, .albedo = 1, .q = frame.q};
  scene.emission.kind = scattering::LampEmission::Kind::lambertian_down;
  scene.distance_m = source.distance_m;
  scene.camera_below_deg = below_deg(source);
  scene.ground = scattering::Ground{.lamp_height_m = source.height_m, .albedo = kGroundAlbedo};
  scattering::CameraRays rays;
  rays.theta_edges_rad = scattering::log_spaced_edges_rad(kFirstDeg, kLastDeg, kRings);
  rays.azimuth_bins = kSectors;
  rays.paths_per_bin = kPathsPerBin;
  rays.seed = night.options.seed * 1'000'003 +
              static_cast<std::uint64_t>(frame.time_utc.time_since_epoch().count()) + lamp;
  const scattering::RayRadiance glow = scattering::simulate_camera(scene, rays);
  const double without_air = glow.direct_irradiance * std::exp(thickness);
  std::vector<double> ln_radiance;
  for (int sector = 0; sector < kSectors; ++sector) {
    for (size_t ring = 0; ring < kRings; ++ring) {
      ln_radiance.push_back(std::log(std::max(symmetric(glow, ring, sector), 1e-300) / without_air));
    }
  }
  const double step = std::log(kLastDeg / kFirstDeg) / static_cast<double>(kRings);
  const double first = std::log(kFirstDeg * std::numbers::pi / 180 * 0.5 * (1 + std::exp(step)));
  return HaloProfile::with_sectors(first, step, std::move(ln_radiance), kSectors);
}

}  // namespace lampglow::simulation
