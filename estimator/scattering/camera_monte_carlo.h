// What a camera sees round one lamp: photons followed backward from the camera in three dimensions, for lamps
// that are not even: a cone, a part hidden, a cut-off luminaire over a lit ground. Lengths in metres.
//
//   LampScene scene;
//   scene.medium = {.extinction_per_m = 2.996 / 400, .albedo = 1, .q = 0.85};
//   scene.emission = {.kind = LampEmission::Kind::lambertian_down};
//   scene.distance_m = 90;  scene.camera_below_deg = 4.5;     // how far the camera is below the lamp's plane
//   scene.ground = {.lamp_height_m = 10, .albedo = 0.2};
//   CameraRays rays;
//   rays.theta_edges_rad = log_spaced_edges_rad(0.1, 8, 16);  rays.azimuth_bins = 12;
//   RayRadiance glow = simulate_camera(scene, rays);
//   glow.radiance(ring, sector).value / glow.direct_irradiance  // [1/sr], relative to the direct beam at the
//   camera
//
// Ring i lies between theta edges i and i+1 from the lamp; sector 0 is centred on straight up in the image,
// sectors go clockwise (to the right first) as the camera sees them. Values are means over the bin's solid
// angle, per unit flux [W/m²/sr per W]; all light that was scattered by air or ground at least once is in
// them, lit ground included; the direct beam is not. Each bin has paths of its own, so the result does not
// depend on how the work is shared.
//
// Method: path tracing with next-event estimation at every vertex; vertices are drawn by nature's law and,
// about the lamp, by the equiangular law (Kulla and Fajardo 2012, CGF 31, 1519), combined by the balance
// heuristic, so that the 1/d² of a near lamp cancels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "estimator/scattering/executor.h"
#include "estimator/scattering/medium.h"
#include "estimator/scattering/monte_carlo.h"

namespace lampglow::scattering {

struct LampEmission {
  enum class Kind {
    isotropic,
    lambertian_down,  // a disc that faces down: intensity cos/π, nothing above its plane
    cone,             // even within opening_deg (full angle, 360 is all round) about the axis, else nothing
    sector,  // a part hidden from the camera's side: even within opening_deg of azimuth about the line of
             // sight, centred on up in the image; the rest is behind a screen
  };
  Kind kind = Kind::isotropic;
  double opening_deg = 360;
  // cone: angle of its axis to the line from lamp to camera, and the axis' turn about that line from up.
  double axis_off_camera_deg = 0;
  double axis_azimuth_deg = 0;
};

struct Ground {
  double lamp_height_m = 10;  // > 0
  double albedo = 0.2;        // Lambertian, 0..1
};

struct LampScene {
  Medium medium;
  LampEmission emission;
  double distance_m = 100;      // lamp to camera, > 0
  double camera_below_deg = 0;  // -80..80; with ground, the camera must stand above it
  std::optional<Ground> ground;
};

struct CameraRays {
  std::vector<double> theta_edges_rad;  // ascending, within 0..π
  std::size_t azimuth_bins = 1;
  std::uint64_t paths_per_bin = 20'000;
  std::uint64_t seed = 1;
  int max_orders = 0;  // 0: all; 1: single scattering only
};

struct RayRadiance {
  std::size_t rings = 0, sectors = 0;
  std::vector<Estimate> values;  // [ring][sector]
  // Per unit flux at the camera, e^(-σR) I/R² [W/m² per W]; 0 if the lamp sends nothing there (for a sector:
  // as if nothing were hidden).
  double direct_irradiance = 0;

  const Estimate& radiance(std::size_t ring, std::size_t sector) const {
    return values.at(ring * sectors + sector);
  }
};

// Throws std::invalid_argument with field and constraint.
RayRadiance simulate_camera(const LampScene& scene, const CameraRays& rays,
                            const Executor& executor = run_serially);

}  // namespace lampglow::scattering
