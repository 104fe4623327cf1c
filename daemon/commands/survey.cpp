#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "daemon/commands/annotate.h"
#include "daemon/commands/commands.h"
#include "daemon/config/files.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/sources/image_file.h"
#include "estimator/photometry/lamps.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/targets.h"

namespace lampglow::daemon {
namespace {

struct Arguments {
  std::vector<std::string> images;
  std::string camera, out, annotated;
  std::string order = "x";
  int most = 60;
  double threshold_sigma = 8;
  bool day = false;
};

// Without a site file: sRGB for 8 bits, linear for more, with the least depth that holds the brightest pixel.
Camera guess_camera(const PlainImage& picture) {
  Camera camera;
  camera.width_px = picture.pixels.width_px, camera.height_px = picture.pixels.height_px;
  camera.principal_x_px = 0.5 * camera.width_px, camera.principal_y_px = 0.5 * camera.height_px;
  camera.bit_depth = picture.bit_depth;
  if (picture.bit_depth == 8) {
    camera.response.kind = Response::Kind::srgb;
  } else {
    const int brightest = *std::max_element(picture.pixels.pixels.begin(), picture.pixels.pixels.end());
    camera.bit_depth = 10;
    while (camera.bit_depth < 16 && brightest >= 1 << camera.bit_depth) camera.bit_depth += 2;
  }
  camera.saturation_dn = std::exp2(camera.bit_depth) - 1;
  return camera;
}

Bracket as_bracket(const PlainImage& picture, const std::string& name) {
  Bracket bracket;
  bracket.exposures.resize(1);
  bracket.exposures[0].name = name;
  bracket.exposures[0].pixels = picture.pixels;
  return bracket;
}

// The lights of one picture; its size must be the camera's.
std::vector<photometry::DetectedLight> lights_of(const PlainImage& picture, const std::string& name,
                                                 const Camera& camera, double threshold_sigma) {
  const photometry::RadianceImage image = photometry::to_radiance(as_bracket(picture, name), camera);
  if (image.empty()) throw DataError(image.fault);
  photometry::DetectionOptions options;
  options.threshold_sigma = threshold_sigma;
  return photometry::detect_lights(image, options);
}

// The surveyed lamps in the order of their numbers.
std::vector<photometry::SurveyedLight> numbered(std::vector<photometry::SurveyedLight> lamps,
                                                const Arguments& arguments) {
  if (lamps.size() > static_cast<std::size_t>(arguments.most))
    lamps.resize(static_cast<std::size_t>(arguments.most));
  if (arguments.order == "x")
    std::stable_sort(lamps.begin(), lamps.end(),
                     [](const auto& a, const auto& b) { return a.light.x_px < b.light.x_px; });
  return lamps;
}

std::string describe(const photometry::SurveyedLight& lamp, int frames) {
  std::string text = fmt::format("# flux {:.4g}, {:.1f} px wide", lamp.light.flux, lamp.light.fwhm_px);
  if (lamp.light.saturated_pixels > 0)
    text += fmt::format(", {} pixels saturated", lamp.light.saturated_pixels);
  if (frames > 1)
    text += fmt::format(", in {} of {} frames, varies by {:.0f} %", lamp.frames_seen, frames,
                        100 * lamp.flux_rel_scatter);
  return text + "\n";
}

std::string left_out(const photometry::Survey& survey) {
  constexpr std::size_t kTold = 10;
  std::string text;
  if (survey.moving.size() > kTold)
    text += fmt::format("# left out: {} lights that are not in most frames; the brightest:\n",
                        survey.moving.size());
  for (std::size_t i = 0; i < std::min(kTold, survey.moving.size()); ++i) {
    const auto& moving = survey.moving[i];
    text += fmt::format("# left out, in {} of {} frames: a light at {:.1f}, {:.1f}\n", moving.frames_seen,
                        survey.frames, moving.light.x_px, moving.light.y_px);
  }
  for (const auto& hot : survey.hot_pixels)
    text +=
        fmt::format("# left out, stays on its pixel when the camera moves: {}, {}\n", hot.column, hot.row);
  return text;
}

std::string snippet(const photometry::Survey& survey, const std::vector<photometry::SurveyedLight>& lamps) {
  std::string text =
      fmt::format("# lampglow survey: {} lamps in {} frame{}; add distance_m where it is known\n",
                  lamps.size(), survey.frames, survey.frames == 1 ? "" : "s");
  text += left_out(survey);
  for (std::size_t i = 0; i < lamps.size(); ++i) {
    Light light;
    light.id = fmt::format("L{}", i + 1);
    light.x_px = std::round(lamps[i].light.x_px * 100) / 100;
    light.y_px = std::round(lamps[i].light.y_px * 100) / 100;
    text += "\n" + describe(lamps[i], survey.frames) + format_light(light);
  }
  return text;
}

std::vector<Mark> marks_of(const photometry::Survey& survey,
                           const std::vector<photometry::SurveyedLight>& lamps) {
  std::vector<Mark> marks;
  const auto add = [&marks](const photometry::DetectedLight& light, std::string label, Mark::Colour colour) {
    Mark mark;
    mark.x_px = light.x_px, mark.y_px = light.y_px;
    mark.radius_px = std::clamp(2 * light.fwhm_px, 5.0, 20.0);
    mark.label = std::move(label);
    mark.colour = colour;
    marks.push_back(mark);
  };
  for (const auto& moving : survey.moving) add(moving.light, "", Mark::Colour::moving);
  for (std::size_t i = 0; i < lamps.size(); ++i)
    add(lamps[i].light, fmt::format("L{}", i + 1), Mark::Colour::lamp);
  return marks;
}

std::vector<Mark> marks_of(const photometry::DaySurvey& survey) {
  std::vector<Mark> marks;
  for (const Target& target : survey.targets) {
    Mark mark;
    mark.x_px = target.x_px, mark.y_px = target.y_px;
    mark.width_px = target.width_px, mark.height_px = target.height_px;
    mark.label = target.id;
    mark.colour = Mark::Colour::target;
    marks.push_back(mark);
  }
  return marks;
}

// Dark and textured places of clear daylight pictures, as [[target]] blocks.
void survey_targets(const Arguments& arguments) {
  const PlainImage first = load_plain_image(arguments.images.front());
  const Camera camera =
      arguments.camera.empty() ? guess_camera(first) : read_site_file(arguments.camera).camera;
  std::vector<photometry::RadianceImage> frames;
  for (const std::string& file : arguments.images) {
    frames.push_back(photometry::to_radiance(as_bracket(load_plain_image(file), file), camera));
    if (frames.back().empty()) throw DataError(file + ": " + frames.back().fault);
  }
  photometry::DaySurveyOptions options;
  options.most_targets = arguments.most;
  const photometry::DaySurvey found = photometry::survey_day(frames, options);
  if (found.targets.empty())
    throw DataError("no skyline found in " + arguments.images.front() + " (is it a clear day's picture?)");
  std::string text = fmt::format("# lampglow survey --day: {} targets; add distance_m where it is known\n",
                                 found.targets.size());
  for (std::size_t i = 0; i < found.targets.size(); ++i)
    text += fmt::format("\n# {}\n", found.skyline[i] ? "on the skyline" : "below the skyline") +
            format_target(found.targets[i]);
  if (arguments.out.empty())
    fmt::print("{}", text);
  else
    write_file_atomically(arguments.out, text);
  if (!arguments.annotated.empty()) write_annotated(arguments.annotated, first.pixels, marks_of(found));
}

void survey(const Arguments& arguments) {
  if (arguments.day) return survey_targets(arguments);
  const PlainImage first = load_plain_image(arguments.images.front());
  const Camera camera =
      arguments.camera.empty() ? guess_camera(first) : read_site_file(arguments.camera).camera;
  std::vector<std::vector<photometry::DetectedLight>> frames;
  for (const std::string& file : arguments.images)
    frames.push_back(lights_of(load_plain_image(file), file, camera, arguments.threshold_sigma));
  const photometry::Survey result = photometry::survey_lights(frames);
  const auto lamps = numbered(result.lamps, arguments);
  if (lamps.empty())
    throw DataError("no lamp found in " + arguments.images.front() + " (is it a clear night's picture?)");
  const std::string text = snippet(result, lamps);
  if (arguments.out.empty())
    fmt::print("{}", text);
  else
    write_file_atomically(arguments.out, text);
  if (!arguments.annotated.empty())
    write_annotated(arguments.annotated, first.pixels, marks_of(result, lamps));
}

}  // namespace

void add_survey(CLI::App& program) {
  CLI::App* command = program.add_subcommand("survey", "Find the lamps in pictures of a clear night");
  auto arguments = std::make_shared<Arguments>();
  command
      ->add_option("IMAGE", arguments->images,
                   "Pictures of one view; with several, cars and hot pixels are left out")
      ->required()
      ->check(CLI::ExistingFile);
  command
      ->add_option("--camera", arguments->camera,
                   "Site file with [camera]; else it is guessed from the picture")
      ->check(CLI::ExistingFile);
  command->add_option("--out", arguments->out,
                      "Write the [[light]] or [[target]] blocks here instead of to the terminal");
  command->add_option("--annotated", arguments->annotated, "Write a PNG with all lamps, or targets, marked");
  command
      ->add_option("--order", arguments->order,
                   "Number lamps from left to right (x) or from the brightest (brightness)")
      ->check(CLI::IsMember({"x", "brightness"}))
      ->capture_default_str();
  command->add_option("--most", arguments->most, "At most this many lamps, the brightest")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  command
      ->add_option("--threshold", arguments->threshold_sigma,
                   "Faintest light, in standard deviations of the noise")
      ->check(CLI::Range(3.0, 1000.0))
      ->capture_default_str();
  command->add_flag("--day", arguments->day,
                    "Find targets for the day in clear daylight pictures instead of lamps");
  command->footer(
      "The lights' places are those of the first picture.\n"
      "Example:\n  lampglow survey clear-1.png clear-2.png clear-3.png --camera site.toml --annotated "
      "lamps.png");
  command->callback([arguments] { survey(*arguments); });
}

}  // namespace lampglow::daemon
