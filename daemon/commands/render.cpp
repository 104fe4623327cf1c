#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <numbers>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/commands/planes.h"
#include "daemon/errors.h"
#include "estimator/scattering/glow_renderer.h"
#include "estimator/scattering/glow_table.h"

namespace lampglow::daemon {
namespace {

struct Options {
  std::string in, out, depth, scattering = "multiple";
  double mor_m = 0, q = 0, distance_m = 0, albedo = 1, airlight = 0, depth_unit_m = 1;
  double focal_px = 0, field_of_view_deg = 40;
  int layers = 8;
  bool quiet = false;
};

std::vector<float> read_depth(const Options& options, const Planes& picture) {
  if (options.depth.empty()) return {};
  Planes map = read_planes(options.depth);
  if (map.width_px != picture.width_px || map.height_px != picture.height_px)
    throw DataError(fmt::format("render: {} is {}x{}, the picture {}x{}", options.depth, map.width_px,
                                map.height_px, picture.width_px, picture.height_px));
  std::vector<float> depth = std::move(map.planes.back());
  // Unknown depth, written as 0: the distance given.
  for (float& value : depth) {
    value = static_cast<float>(value * options.depth_unit_m);
    if (!(value > 0)) value = static_cast<float>(options.distance_m);
  }
  return depth;
}

void draw_progress(std::size_t done, std::size_t total) {
  constexpr std::size_t width = 40;
  const std::size_t filled = done * width / total;
  fmt::print(stderr, "\r[{}{}] {:3} %", std::string(filled, '#'), std::string(width - filled, ' '),
             100 * done / total);
  if (done == total) std::fputc('\n', stderr);
}

void run(const Options& options) {
  Planes picture = read_planes(options.in);
  refuse_unwritable(options.out, picture);
  to_linear(picture);
  const std::vector<float> depth = read_depth(options, picture);
  scattering::RenderOptions fog;
  fog.medium = {scattering::extinction_from_mor_per_m(options.mor_m), options.albedo, options.q};
  fog.focal_length_px =
      options.focal_px > 0
          ? options.focal_px
          : picture.width_px / (2 * std::tan(options.field_of_view_deg / 2 * std::numbers::pi / 180));
  fog.single_only = options.scattering == "single";
  fog.airlight = options.airlight;
  fog.depth_layers = options.layers;
  const bool bar = !options.quiet && isatty(STDERR_FILENO) != 0;
  const std::size_t planes = picture.planes.size();
  for (std::size_t c = 0; c < planes; ++c) {
    std::vector<float> foggy(picture.planes[c].size());
    const auto progress = [&](std::size_t done, std::size_t total) {
      if (bar) draw_progress(c * total + done, planes * total);
    };
    try {
      scattering::render_glow(picture.planes[c], picture.width_px, picture.height_px, depth,
                              options.distance_m, fog, foggy, progress);
    } catch (const std::domain_error& error) {
      throw UsageError(fmt::format("render: {} (MOR {} m, distance {} m)", error.what(), options.mor_m,
                                   options.distance_m));
    }
    picture.planes[c] = std::move(foggy);
  }
  const int width = picture.width_px, height = picture.height_px;
  write_planes(options.out, std::move(picture));
  fmt::print("{}: {}x{}, MOR {} m, q {}, {} scattering, focal length {:.1f} px\n", options.out, width, height,
             options.mor_m, options.q, options.scattering, fog.focal_length_px);
}

}  // namespace

void add_render(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand("render", "Put fog's glow into a clear night picture");
  command
      ->add_option("IN", options->in, "Clear picture: EXR, TIFF or PNG; 8-bit is taken as sRGB, else linear")
      ->required();
  command
      ->add_option("OUT", options->out,
                   "Picture to write; .exr is float, else as IN: 8 or 16 bits, or float .tiff")
      ->required();
  command->add_option("--mor", options->mor_m, "Visibility as MOR [m]")
      ->required()
      ->check(CLI::PositiveNumber);
  command->add_option("--q", options->q, "Henyey-Greenstein asymmetry, 0 to 0.97")->required();
  command->add_option("--distance", options->distance_m, "Distance of the lamps [m]")
      ->required()
      ->check(CLI::PositiveNumber);
  command->add_option("--depth", options->depth,
                      "Depth map of the same size; 0 where unknown (then --distance)");
  command->add_option("--depth-unit", options->depth_unit_m, "Metres per unit of the depth map")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--layers", options->layers, "Distances that the depth map is resolved into")
      ->check(CLI::Range(2, 64))
      ->capture_default_str();
  command->add_option("--scattering", options->scattering, "single or multiple")
      ->check(CLI::IsMember({"single", "multiple"}))
      ->capture_default_str();
  command->add_option("--albedo", options->albedo, "Single scattering albedo, 0.8 to 1")
      ->capture_default_str();
  command->add_option("--airlight", options->airlight, "Brightness of the horizon, in linear units of IN")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command->add_option("--focal-px", options->focal_px, "Focal length in pixels (instead of --fov-deg)")
      ->check(CLI::PositiveNumber);
  command->add_option("--fov-deg", options->field_of_view_deg, "Horizontal field of view")
      ->check(CLI::Range(1.0, 150.0))
      ->capture_default_str();
  command->add_flag("--quiet", options->quiet, "No progress bar");
  command->footer(
      "Example:\n  lampglow render clear.exr foggy.exr --mor 300 --q 0.9 --distance 120 --fov-deg 40");
  command->callback([options] { run(*options); });
}

}  // namespace lampglow::daemon
