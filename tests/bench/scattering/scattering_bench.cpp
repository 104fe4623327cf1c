// How fast the scattering library is. Run: build/release/tests/bench/scattering/scattering_bench
#include <benchmark/benchmark.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "estimator/scattering/glow_renderer.h"
#include "estimator/scattering/glow_table.h"
#include "estimator/scattering/monte_carlo.h"
#include "estimator/scattering/single_scattering.h"

namespace lampglow::scattering {
namespace {

std::vector<double> rings() {
  std::vector<double> theta;
  theta.reserve(64);
  for (int i = 0; i < 64; ++i) theta.push_back(0.15 * std::pow(50, i / 63.0) * std::numbers::pi / 180);
  return theta;
}

// A fit's call: 64 rings, both derivatives, air that changes from call to call.
void profile_of_64_rings(benchmark::State& state) {
  const std::vector<double> theta = rings();
  std::vector<double> total(64), d_t(64), d_q(64);
  double thickness = 0.5;
  for (auto _ : state) {
    thickness = thickness > 5 ? 0.5 : thickness * 1.001;
    default_glow_table().profile(thickness, 0.85, 0.98, theta, total, d_t, d_q);
    benchmark::DoNotOptimize(total.data());
  }
}
BENCHMARK(profile_of_64_rings)->Unit(benchmark::kMicrosecond);

void single_scattering_with_derivatives(benchmark::State& state) {
  for (auto _ : state) benchmark::DoNotOptimize(single_scattering(1.5, 0.85, 0.98, 0.02));
}
BENCHMARK(single_scattering_with_derivatives)->Unit(benchmark::kMicrosecond);

// Photons to their end in an infinite medium without absorption, counted on five spheres; argument: q in per
// cent.
void photons(benchmark::State& state) {
  GlowPhotons run;
  run.q = static_cast<double>(state.range(0)) / 100;
  run.thicknesses = {0.1, 0.3, 1, 2, 4};
  run.theta_edges_rad = log_spaced_edges_rad(0.05, 90, 40);
  run.photons = std::uint64_t{64} * 500;
  for (auto _ : state) {
    ++run.seed;
    benchmark::DoNotOptimize(simulate_glow(run));
  }
  state.counters["photons"] =
      benchmark::Counter(static_cast<double>(state.iterations()) * 64 * 500, benchmark::Counter::kIsRate);
}
BENCHMARK(photons)->Arg(0)->Arg(75)->Arg(90)->Unit(benchmark::kMillisecond);

void render_12_megapixels(benchmark::State& state) {
  RenderOptions options;
  options.medium = {0.01, 1, 0.9};
  options.focal_length_px = 5000;
  std::vector<float> clear(std::size_t{4000} * 3000, 0.01f), out(clear.size());
  for (auto _ : state) render_glow(clear, 4000, 3000, {}, 100, options, out);
}
BENCHMARK(render_12_megapixels)->Unit(benchmark::kMillisecond);

void bare_transforms_of_12_megapixels(benchmark::State& state) {
  for (auto _ : state) bare_transforms(4000, 3000);
}
BENCHMARK(bare_transforms_of_12_megapixels)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace lampglow::scattering

BENCHMARK_MAIN();
