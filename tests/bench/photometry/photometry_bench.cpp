// How long each stage of photometry takes on a bracket of 1520x1008 pixels, 12 bits, three exposures, beside
// the decoding of the same three files: `photometry_bench`, in a release build.
#include <benchmark/benchmark.h>

#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "daemon/sources/image_file.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/registration.h"
#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

struct Setup {
  Camera camera = scene::camera_12_bit(1520, 1008);
  Bracket bracket;
  std::vector<CatalogueLamp> catalogue;
  std::filesystem::path folder = std::filesystem::temp_directory_path() / "lampglow_photometry_bench";

  Setup() {
    std::mt19937_64 random(1);
    Image<double> truth(1520, 1008);
    for (int y = 0; y < 1008; ++y)
      for (int x = 0; x < 1520; ++x) truth.at(x, y) = 20 + 60.0 * y / 1008;
    for (int i = 0; i < 7; ++i) {
      CatalogueLamp lamp;
      lamp.id = "L" + std::to_string(i + 1);
      lamp.x_px = 120 + 200 * i, lamp.y_px = 420 + 37 * (i % 4);
      catalogue.push_back(lamp);
      scene::add_lamp(truth, {lamp.x_px + 1.3, lamp.y_px - 0.8, std::pow(10, 4 + 0.35 * i), 1.0, 0.05, 20});
    }
    bracket = scene::bracket(truth, camera, {8, 1, 0.125}, random);
    std::filesystem::create_directories(folder);
    for (size_t i = 0; i < 3; ++i) {
      Exposure& exposure = bracket.exposures[i];
      exposure.name = std::string(1, static_cast<char>('a' + i)) + ".png";
      cv::imwrite((folder / exposure.name).string(),
                  cv::Mat(1008, 1520, CV_16U, exposure.pixels.pixels.data()));
    }
  }
};

const Setup& setup() {
  static const Setup instance;
  return instance;
}

void decode_three_files(benchmark::State& state) {
  setup();  // not on the clock
  for (auto _ : state)
    for (const Exposure& exposure : setup().bracket.exposures)
      benchmark::DoNotOptimize(daemon::load_image(setup().folder, exposure.name, setup().camera));
}
BENCHMARK(decode_three_files)->Unit(benchmark::kMillisecond)->UseRealTime();

void radiance(benchmark::State& state) {
  setup();
  for (auto _ : state) benchmark::DoNotOptimize(to_radiance(setup().bracket, setup().camera));
}
BENCHMARK(radiance)->Unit(benchmark::kMillisecond)->UseRealTime();

void registration(benchmark::State& state) {
  const RadianceImage image = to_radiance(setup().bracket, setup().camera);
  RegistrationOptions options;
  options.find_strays = state.range(0) != 0;
  for (auto _ : state) benchmark::DoNotOptimize(register_frame(image, setup().catalogue, options));
}
BENCHMARK(registration)->Arg(1)->Arg(0)->ArgName("strays")->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace lampglow::photometry

BENCHMARK_MAIN();
