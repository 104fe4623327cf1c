#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <numbers>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
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

// Large pictures pass; bombs do not.
constexpr std::uintmax_t kMaxFileBytes = std::uintmax_t{4} << 30;

cv::Mat read_picture(const std::string& path) {
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  if (error) throw IoError(fmt::format("render: cannot read {}: {}", path, error.message()));
  if (size > kMaxFileBytes) throw DataError(fmt::format("render: {} is larger than 4 GB", path));
  cv::Mat picture;
  try {
    picture = cv::imread(path, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception& exception) {
    throw DataError(fmt::format("render: {}: {}", path, exception.what()));
  }
  if (picture.empty()) throw DataError(fmt::format("render: {} is not a picture that can be decoded", path));
  const int depth = picture.depth();
  if (depth != CV_8U && depth != CV_16U && depth != CV_32F && depth != CV_64F)
    throw DataError(
        fmt::format("render: {} has an unusual sample type; expected 8 or 16 bits or float", path));
  return picture;
}

bool is_real(int sample_type) {
  return sample_type != CV_8U && sample_type != CV_16U;
}

// 8-bit pictures carry the sRGB curve, everything deeper is linear.
std::vector<cv::Mat> linear_channels(const cv::Mat& picture) {
  cv::Mat real = picture;
  if (picture.depth() != CV_32F) picture.convertTo(real, CV_32F);
  std::vector<cv::Mat> channels;
  cv::split(real, channels);
  if (picture.depth() == CV_8U)
    for (cv::Mat& channel : channels)
      channel.forEach<float>([](float& value, const int*) {
        const float x = value / 255;
        value = 255 * (x <= 0.04045f ? x / 12.92f : std::pow((x + 0.055f) / 1.055f, 2.4f));
      });
  if (channels.size() == 4 || channels.size() == 2) channels.pop_back();  // transparency
  return channels;
}

void to_srgb(cv::Mat& channel) {
  channel.forEach<float>([](float& value, const int*) {
    const float x = std::max(value, 0.0f) / 255;
    value = 255 * (x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f);
  });
}

// Brightness of a float picture has no end that could be white: it is not squeezed into integers.
void refuse_integers_for_float(const std::string& out, int sample_type) {
  const std::string extension = std::filesystem::path(out).extension().string();
  if (is_real(sample_type) && extension != ".exr" && extension != ".tif" && extension != ".tiff")
    throw UsageError(fmt::format("render: {}: a float picture is written as .exr or .tiff", out));
}

void write_picture(const std::string& path, std::vector<cv::Mat> channels, int sample_type) {
  const std::string extension = std::filesystem::path(path).extension().string();
  const bool real = extension == ".exr" || is_real(sample_type);
  cv::Mat picture;
  if (!real && sample_type == CV_8U)
    for (cv::Mat& channel : channels) to_srgb(channel);
  cv::merge(channels, picture);
  channels.clear();
  if (!real) picture.convertTo(picture, sample_type);  // rounds, and clips at full scale
  try {
    if (!cv::imwrite(path, picture)) throw IoError(fmt::format("render: cannot write {}", path));
  } catch (const cv::Exception& exception) {
    throw IoError(fmt::format("render: cannot write {}: {}", path, exception.what()));
  }
}

std::vector<float> read_depth(const Options& options, const cv::Size& size) {
  if (options.depth.empty()) return {};
  cv::Mat map = read_picture(options.depth);
  if (map.channels() != 1) cv::extractChannel(map, map, 0);
  if (map.size() != size)
    throw DataError(fmt::format("render: {} is {}x{}, the picture {}x{}", options.depth, map.cols, map.rows,
                                size.width, size.height));
  map.convertTo(map, CV_32F, options.depth_unit_m);
  std::vector<float> depth;
  for (int row = 0; row < map.rows; ++row)
    depth.insert(depth.end(), map.ptr<float>(row), map.ptr<float>(row) + map.cols);
  // Unknown depth, written as 0: the distance given.
  for (float& value : depth)
    if (!(value > 0)) value = static_cast<float>(options.distance_m);
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
  setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 1);  // Debian's OpenCV has OpenEXR, switched off by default
  cv::Mat clear = read_picture(options.in);
  const cv::Size size = clear.size();
  const int sample_type = clear.depth();
  refuse_integers_for_float(options.out, sample_type);
  std::vector<cv::Mat> channels = linear_channels(clear);
  clear.release();  // pictures are large
  const std::vector<float> depth = read_depth(options, size);
  scattering::RenderOptions fog;
  fog.medium = {scattering::extinction_from_mor_per_m(options.mor_m), options.albedo, options.q};
  fog.focal_length_px =
      options.focal_px > 0
          ? options.focal_px
          : size.width / (2 * std::tan(options.field_of_view_deg / 2 * std::numbers::pi / 180));
  fog.single_only = options.scattering == "single";
  fog.airlight = options.airlight;
  fog.depth_layers = options.layers;
  const bool bar = !options.quiet && isatty(STDERR_FILENO) != 0;
  const std::size_t planes = channels.size();
  for (std::size_t c = 0; c < planes; ++c) {
    cv::Mat foggy(size, CV_32F);
    const auto progress = [&](std::size_t done, std::size_t total) {
      if (bar) draw_progress(c * total + done, planes * total);
    };
    try {
      scattering::render_glow({channels[c].ptr<float>(), channels[c].total()}, size.width, size.height, depth,
                              options.distance_m, fog, {foggy.ptr<float>(), foggy.total()}, progress);
    } catch (const std::domain_error& error) {
      throw UsageError(fmt::format("render: {} (MOR {} m, distance {} m)", error.what(), options.mor_m,
                                   options.distance_m));
    }
    channels[c] = foggy;
  }
  write_picture(options.out, std::move(channels), sample_type);
  fmt::print("{}: {}x{}, MOR {} m, q {}, {} scattering, focal length {:.1f} px\n", options.out, size.width,
             size.height, options.mor_m, options.q, options.scattering, fog.focal_length_px);
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
