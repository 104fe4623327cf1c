#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/config/csv.h"
#include "daemon/config/files.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/sources/archive.h"
#include "daemon/sources/image_file.h"
#include "estimator/photometry/response_measurement.h"

namespace lampglow::daemon {
namespace {

struct Arguments {
  std::vector<std::string> inputs;
  std::string out = "response.csv";
  std::string method = "debevec";
  int bit_depth = 0;  // 0: the file's
};

struct Pictures {
  std::vector<Exposure> exposures;
  int bit_depth = 8;
};

// FILE@SECONDS; the seconds may also be a fraction, "1/30".
Exposure read_exposure(const std::string& input, int& bit_depth) {
  const std::size_t at = input.rfind('@');
  if (at == std::string::npos)
    throw UsageError(input + ": expected FILE@SECONDS, as in night.png@0.5 or night.png@1/30");
  const std::string text = input.substr(at + 1);
  const std::size_t slash = text.find('/');
  const auto above = parse_number(text.substr(0, slash));
  const auto below =
      slash == std::string::npos ? std::optional<double>(1) : parse_number(text.substr(slash + 1));
  if (!above || !below || !(*above > 0) || !(*below > 0))
    throw UsageError(input + ": expected an exposure time in seconds after @, as in 0.5 or 1/30");
  const PlainImage picture = load_plain_image(input.substr(0, at));
  bit_depth = picture.bit_depth;
  Exposure exposure;
  exposure.name = input.substr(0, at);
  exposure.exposure_s = *above / *below;
  exposure.pixels = picture.pixels;
  return exposure;
}

// The bracket of an archive with the most exposures of different, known time.
Pictures read_archive(const std::filesystem::path& archive) {
  const Camera camera = read_site_file(archive / "site.toml").camera;
  const std::vector<ArchiveBracket> brackets = read_frames_csv(archive);
  const auto timed = [](const ArchiveBracket& bracket) {
    return std::count_if(bracket.frames.begin(), bracket.frames.end(),
                         [](const auto& frame) { return frame.exposure_s.has_value(); });
  };
  const auto best = std::max_element(brackets.begin(), brackets.end(),
                                     [&](const auto& a, const auto& b) { return timed(a) < timed(b); });
  if (best == brackets.end() || timed(*best) < 2)
    throw DataError(archive.string() +
                    ": expected a bracket of at least two exposures with exposure_s in frames.csv");
  const Bracket bracket = load_bracket(archive, *best, camera);
  if (!bracket.fault.empty()) throw DataError(bracket.fault);
  return {bracket.exposures, camera.bit_depth};
}

// Deeper files than 8 bits have 16 bits a sample, of which the camera may use fewer: the least depth that
// holds all of them.
int used_depth(const std::vector<Exposure>& exposures) {
  int brightest = 0;
  for (const Exposure& exposure : exposures)
    brightest = std::max<int>(
        brightest, *std::max_element(exposure.pixels.pixels.begin(), exposure.pixels.pixels.end()));
  int depth = 10;
  while (depth < 16 && brightest >= 1 << depth) depth += 2;
  return depth;
}

Pictures read_pictures(const Arguments& arguments) {
  if (arguments.inputs.size() == 1 && std::filesystem::is_directory(arguments.inputs.front()))
    return read_archive(arguments.inputs.front());
  Pictures pictures;
  for (const std::string& input : arguments.inputs) {
    int depth = 8;
    pictures.exposures.push_back(read_exposure(input, depth));
    pictures.bit_depth = std::max(pictures.bit_depth, depth);
  }
  if (pictures.bit_depth > 8) pictures.bit_depth = used_depth(pictures.exposures);
  if (arguments.bit_depth > 0) pictures.bit_depth = arguments.bit_depth;
  return pictures;
}

void calibrate(const Arguments& arguments) {
  const Pictures pictures = read_pictures(arguments);
  const auto method = arguments.method == "debevec" ? photometry::ResponseMethod::debevec
                                                    : photometry::ResponseMethod::robertson;
  photometry::MeasuredResponse response;
  try {
    response = photometry::measure_response(pictures.exposures, pictures.bit_depth, method);
  } catch (const std::invalid_argument& error) {
    throw DataError(error.what());
  }
  write_file_atomically(arguments.out, format_response_curve(response.curve));
  fmt::print("{}: {} DN from {} exposures and {} places by {}\n", arguments.out, response.curve.size(),
             response.exposures, response.samples, arguments.method);
  fmt::print(
      "exposures agree within {:.1f} % by this curve; nearest power law: {:.2f} (1 is linear, 2.2 about "
      "sRGB)\n",
      100 * response.rms_rel, response.best_gamma);
  if (response.rms_rel > 0.15)
    fmt::print("this is a poor agreement: did the camera move, or its gain change between the exposures?\n");
  fmt::print("in the site file: response = \"{}\", bit_depth = {}\n",
             std::filesystem::path(arguments.out).filename().string(), pictures.bit_depth);
}

}  // namespace

void add_calibrate_response(CLI::App& program) {
  CLI::App* command = program.add_subcommand(
      "calibrate-response", "Measure the camera's response curve from a series of exposures");
  auto arguments = std::make_shared<Arguments>();
  command
      ->add_option(
          "IMAGE@SECONDS", arguments->inputs,
          "Pictures of one still scene with their exposure times, best a factor of two apart; or an archive")
      ->required();
  command->add_option("--out", arguments->out, "Curve file, for response in the site file")
      ->capture_default_str();
  command->add_option("--method", arguments->method, "Debevec and Malik 1997, or Robertson et al. 1999")
      ->check(CLI::IsMember({"debevec", "robertson"}))
      ->capture_default_str();
  command
      ->add_option("--bit-depth", arguments->bit_depth,
                   "Bits a camera uses of deeper files; else taken from the brightest pixel")
      ->check(CLI::Range(8, 16));
  command->footer(
      "Example:\n"
      "  lampglow calibrate-response a.png@1/60 b.png@1/30 c.png@1/15 d.png@1/8 e.png@1/4 --out "
      "response.csv");
  command->callback([arguments] { calibrate(*arguments); });
}

}  // namespace lampglow::daemon
