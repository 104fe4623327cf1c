#include "estimator/scattering/monte_carlo.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <thread>

#include "estimator/scattering/camera_monte_carlo.h"
#include "estimator/scattering/glow_table.h"
#include "estimator/scattering/single_scattering.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180;

// Two threads that take the blocks from the far end.
void backwards_on_two_threads(std::size_t count, const std::function<void(std::size_t)>& task) {
  std::jthread even([&] {
    for (std::size_t i = count; i-- > 0;)
      if (i % 2 == 0) task(i);
  });
  for (std::size_t i = count; i-- > 0;)
    if (i % 2 == 1) task(i);
}

GlowPhotons small_run() {
  GlowPhotons run;
  run.q = 0.8;
  run.albedos = {1, 0.9};
  run.thicknesses = {0.5, 2};
  run.theta_edges_rad = log_spaced_edges_rad(0.1, 180, 12);
  run.photons = 100'000;
  return run;
}

TEST(MonteCarlo, GivesTheSameBitsForAnyNumberOfThreads) {
  const GlowEstimate one = simulate_glow(small_run()),
                     two = simulate_glow(small_run(), backwards_on_two_threads);
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t t = 0; t < 2; ++t)
      for (std::size_t b = 0; b < one.bins(); ++b) {
        EXPECT_EQ(one.total(a, t, b).value, two.total(a, t, b).value);
        EXPECT_EQ(one.total(a, t, b).sigma, two.total(a, t, b).sigma);
      }
}

TEST(MonteCarlo, FirstOrderIsTheAirlightIntegralAndErrorsAreHonest) {
  GlowPhotons run = small_run();
  run.photons = 400'000;
  // Narrow rings, so that the ring's mean is the value at its middle.
  run.theta_edges_rad.clear();
  for (const double theta : {1.0, 4.0, 15.0, 60.0, 120.0})
    for (const double side : {0.97, 1.03}) run.theta_edges_rad.push_back(theta * side * kDegree);
  const GlowEstimate glow = simulate_glow(run);
  double squares = 0;
  int count = 0;
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t t = 0; t < 2; ++t)
      for (std::size_t b = 0; b < glow.bins(); b += 2, ++count) {
        const double theta = (run.theta_edges_rad[b] + run.theta_edges_rad[b + 1]) / 2;
        const double truth = single_scattering(run.thicknesses[t], run.q, run.albedos[a], theta).value;
        const Estimate single = glow.single(a, t, b);
        EXPECT_NEAR(single.value, truth, 4.5 * single.sigma) << theta / kDegree;
        squares += std::pow((single.value - truth) / single.sigma, 2);
      }
  EXPECT_GT(squares / count, 0.3);
  EXPECT_LT(squares / count, 2.5);
}

TEST(MonteCarlo, AgreesWithTheTable) {
  GlowPhotons run;
  run.q = 0.9;
  run.albedos = {1, 0.85};
  run.thicknesses = {0.5, 3};
  for (const double theta : {0.5, 3.0, 20.0, 45.0})
    for (const double side : {0.96, 1.04}) run.theta_edges_rad.push_back(theta * side * kDegree);
  run.photons = 500'000;
  const GlowEstimate glow = simulate_glow(run, backwards_on_two_threads);
  for (std::size_t a = 0; a < 2; ++a)
    for (std::size_t t = 0; t < 2; ++t)
      for (std::size_t b = 0; b < glow.bins(); b += 2) {
        const double theta = (run.theta_edges_rad[b] + run.theta_edges_rad[b + 1]) / 2;
        double single = 0, multiple = 0;
        default_glow_table().parts(run.thicknesses[t], run.q, run.albedos[a], {&theta, 1}, {&single, 1},
                                   {&multiple, 1});
        const Estimate total = glow.total(a, t, b);
        EXPECT_NEAR(total.value, single + multiple, 4 * total.sigma + 0.005 * total.value) << theta / kDegree;
      }
}

TEST(MonteCarlo, ConservesEnergy) {
  GlowPhotons run;
  run.q = 0.8;
  run.thicknesses = {0.3, 1, 4};
  run.theta_edges_rad.push_back(0);
  for (int i = 1; i <= 1800; ++i) run.theta_edges_rad.push_back(i * kPi / 1800);
  run.photons = 300'000;
  const GlowEstimate glow = simulate_glow(run, backwards_on_two_threads);
  for (std::size_t t = 0; t < 3; ++t) {
    double flux = direct_irradiance(run.thicknesses[t]);
    for (std::size_t b = 0; b < glow.bins(); ++b)
      flux += glow.total(0, t, b).value *
              ring_solid_angle_sr(run.theta_edges_rad[b], run.theta_edges_rad[b + 1]) *
              std::cos((run.theta_edges_rad[b] + run.theta_edges_rad[b + 1]) / 2);
    EXPECT_NEAR(flux * 4 * kPi * std::pow(run.thicknesses[t], 2), 1, 0.005) << run.thicknesses[t];
  }
}

TEST(MonteCarlo, FarFieldDoesNotMatter) {
  // Where photons stop being followed one by one is a matter of cost alone.
  GlowPhotons run;
  run.q = 0.5;
  run.albedos = {1, 0.95};
  run.thicknesses = {3};
  run.theta_edges_rad = {20 * kDegree, 60 * kDegree};
  run.photons = 400'000;
  const GlowEstimate near = simulate_glow(run, backwards_on_two_threads);
  run.far_margin = 5;
  run.seed = 2;
  const GlowEstimate far = simulate_glow(run, backwards_on_two_threads);
  for (std::size_t a = 0; a < 2; ++a)
    EXPECT_NEAR(near.total(a, 0, 0).value / far.total(a, 0, 0).value, 1, 0.012);
}

TEST(MonteCarlo, RefusesRunsThatCannotBe) {
  const auto refused = [](auto change) {
    GlowPhotons run = small_run();
    change(run);
    EXPECT_THROW(simulate_glow(run), std::invalid_argument);
  };
  refused([](GlowPhotons& run) { run.q = 1; });
  refused([](GlowPhotons& run) { run.albedos = {}; });
  refused([](GlowPhotons& run) { run.thicknesses = {2, 1}; });
  refused([](GlowPhotons& run) { run.theta_edges_rad = {0.1}; });
  refused([](GlowPhotons& run) { run.photons = 0; });
  refused([](GlowPhotons& run) { run.black_radius = 1; });
}

CameraRays rays_at(std::initializer_list<double> theta_deg, std::uint64_t paths) {
  CameraRays rays;
  for (const double theta : theta_deg)
    for (const double side : {0.97, 1.03}) rays.theta_edges_rad.push_back(theta * side * kDegree);
  rays.paths_per_bin = paths;
  return rays;
}

TEST(CameraMonteCarlo, EvenLampInOpenAirIsTheGlowTable) {
  LampScene scene;
  scene.medium = {0.01, 0.95, 0.8};
  scene.distance_m = 80;
  const RayRadiance seen = simulate_camera(scene, rays_at({0.5, 3, 15}, 30'000), backwards_on_two_threads);
  const double theta_deg[] = {0.5, 3, 15};
  for (std::size_t i = 0; i < 3; ++i) {
    const double theta = theta_deg[i] * kDegree;
    double single = 0, multiple = 0;
    default_glow_table().parts(0.8, 0.8, 0.95, {&theta, 1}, {&single, 1}, {&multiple, 1});
    const Estimate value = seen.radiance(2 * i, 0);
    EXPECT_NEAR(value.value / ((single + multiple) * 1e-4), 1, 0.03 + 3 * value.sigma / value.value);
  }
  EXPECT_NEAR(seen.direct_irradiance, direct_irradiance(0.8) * 1e-4, 1e-12);
}

TEST(CameraMonteCarlo, ConeSectorAndDiscHaveTheirShapes) {
  LampScene scene;
  scene.medium = {0.01, 1, 0.8};
  CameraRays rays = rays_at({2}, 8'000);
  rays.azimuth_bins = 4;
  rays.max_orders = 1;
  const RayRadiance even = simulate_camera(scene, rays);
  // A quarter of the azimuth open, centred on up: single scattering shows up alone, four times as bright.
  scene.emission = {LampEmission::Kind::sector, 90, 0, 0};
  const RayRadiance sector = simulate_camera(scene, rays);
  EXPECT_NEAR(sector.radiance(0, 0).value / even.radiance(0, 0).value, 4, 0.3);
  EXPECT_EQ(sector.radiance(0, 2).value, 0);
  // A cone of 180° away from the camera: no direct beam, and next to nothing scattered once.
  scene.emission = {LampEmission::Kind::cone, 180, 180, 0};
  const RayRadiance away = simulate_camera(scene, rays);
  EXPECT_EQ(away.direct_irradiance, 0);
  EXPECT_LT(away.radiance(0, 0).value, 0.1 * even.radiance(0, 0).value);
  // A disc facing down, the camera 4.5° below its plane: brighter below than above, as measured (physics.md).
  scene.emission = {LampEmission::Kind::lambertian_down, 360, 0, 0};
  scene.camera_below_deg = 4.5;
  scene.ground = Ground{};
  const RayRadiance disc = simulate_camera(scene, rays);
  EXPECT_GT(disc.radiance(0, 2).value, 1.5 * disc.radiance(0, 0).value);
  EXPECT_NEAR(disc.radiance(0, 1).value / disc.radiance(0, 3).value, 1, 0.2);
}

TEST(CameraMonteCarlo, RefusesACameraUnderTheGround) {
  LampScene scene;
  scene.medium = {0.01, 1, 0.8};
  scene.distance_m = 300;
  scene.camera_below_deg = 4.5;
  scene.ground = Ground{};
  EXPECT_THROW(simulate_camera(scene, rays_at({2}, 100)), std::invalid_argument);
}

}  // namespace
}  // namespace lampglow::scattering
