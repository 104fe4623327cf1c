// Opens a camera as the daemon would, and says what it is and what is wrong with it.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>

#include "daemon/commands/commands.h"
#include "daemon/config/files.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/pictures/png.h"
#include "daemon/replay/stop_on_signal.h"
#include "daemon/schedule/clock.h"
#include "daemon/sources/checks.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/libcamera_camera.h"
#include "daemon/sources/open_source.h"

namespace lampglow::daemon {
namespace {

namespace fs = std::filesystem;
using SteadyClock = std::chrono::steady_clock;

struct ProbeOptions {
  SourceOptions source;
  std::vector<double> exposures_s;
  double timeout_s = 20;
  std::string output;
};

void describe(const FrameSource& source, const SourceInfo& info) {
  fmt::print("source    {}\n", source.name());
  fmt::print("driver    {}\n", info.driver.empty() ? "unknown" : info.driver);
  for (std::size_t i = 0; i < info.formats.size(); ++i) {
    fmt::print("{}{}\n", i == 0 ? "in use    " : "offers    ", info.formats[i]);
  }
  for (const std::string& control : info.controls) fmt::print("control   {}\n", control);
  if (info.exposure_min_s && info.exposure_max_s) {
    fmt::print("exposure  {:g} s to {:g} s\n", *info.exposure_min_s, *info.exposure_max_s);
  }
  fmt::print("locked    {}\n", !info.locked ? "can't be known" : *info.locked ? "yes" : "NO");
  for (const std::string& note : info.notes) fmt::print("note      {}\n", note);
}

// For `probe libcamera:`, whose cameras have names that nobody guesses.
void list_cameras() {
  const auto cameras = list_libcamera();
  if (cameras.empty())
    throw IoError(fmt::format("{}: libcamera finds no camera\n  {}", to_string(Fault::device_missing),
                              fault_info(Fault::device_missing).meaning));
  for (const LibcameraListing& camera : cameras) {
    fmt::print("source    libcamera:{}\n", camera.id);
    fmt::print("driver    {}\n", camera.info.driver);
    for (const std::string& format : camera.info.formats) fmt::print("offers    {}\n", format);
    for (const std::string& control : camera.info.controls) fmt::print("control   {}\n", control);
  }
}

// What the device says of its samples; else enough bits for the brightest, 8 at least.
int bit_depth_of(const SourceInfo& info, const Bracket& bracket) {
  if (info.bit_depth) return *info.bit_depth;
  int highest = 0;
  for (const Exposure& exposure : bracket.exposures) {
    highest = std::max<int>(highest, *std::ranges::max_element(exposure.pixels.pixels));
  }
  return highest < 256 ? 8 : 16;
}

void write_png(const fs::path& file, const Image<std::uint16_t>& picture, int bit_depth) {
  const auto& wide = picture.pixels;
  Bytes png;
  if (bit_depth > 8) {
    png = encode_png({{picture.width_px, picture.height_px, 1, 16}, std::span<const std::uint16_t>(wide)});
  } else {
    std::vector<std::uint8_t> narrow(wide.size());
    std::ranges::transform(wide, narrow.begin(),
                           [](int dn) { return static_cast<std::uint8_t>(std::min(dn, 255)); });
    png = encode_png({{picture.width_px, picture.height_px, 1, 8}, std::span<const std::uint8_t>(narrow)});
  }
  write_file_atomically(file, {reinterpret_cast<const char*>(png.data()), png.size()});
}

std::string text_or_empty(std::optional<double> value) {
  return value ? fmt::format("{}", *value) : "";
}

void save(const Bracket& bracket, int bit_depth, const fs::path& archive) {
  if (fs::exists(archive / "frames.csv")) {
    throw UsageError(fmt::format("{}: expected a new folder, an archive is there already", archive.string()));
  }
  fs::create_directories(archive / "images");
  std::string rows = "time_utc,file,exposure_s,gain_db,role,reference_mor_m\n";
  for (std::size_t i = 0; i < bracket.exposures.size(); ++i) {
    const Exposure& exposure = bracket.exposures[i];
    const std::string file = fmt::format("images/0000_{}.png", i);
    write_png(archive / file, exposure.pixels, bit_depth);
    rows += fmt::format("{},{},{},{},observation,\n", format_time_utc(bracket.time_utc), file,
                        text_or_empty(exposure.exposure_s), text_or_empty(exposure.gain_db));
  }
  Site site;
  site.name = "probe";
  site.camera.width_px = bracket.exposures.front().pixels.width_px;
  site.camera.height_px = bracket.exposures.front().pixels.height_px;
  site.camera.principal_x_px = site.camera.width_px / 2.0;
  site.camera.principal_y_px = site.camera.height_px / 2.0;
  site.camera.bit_depth = bit_depth;
  site.camera.saturation_dn = (1 << bit_depth) - 1;
  site.camera.response.kind = bit_depth == 8 ? Response::Kind::srgb : Response::Kind::linear;
  write_site_file(archive / "site.toml", site);
  write_file_atomically(archive / "frames.csv", rows);
  fmt::print("saved     {} (one bracket of {} exposures; complete its site.toml)\n", archive.string(),
             bracket.exposures.size());
}

void tell_exposures(const Bracket& bracket, int bit_depth) {
  const int full = (1 << bit_depth) - 1;
  for (const Exposure& exposure : bracket.exposures) {
    auto sorted = exposure.pixels.pixels;
    std::ranges::sort(sorted);
    const auto saturated = std::ranges::count(sorted, full);
    fmt::print("picture   {}x{} {}, exposure {}, gain {}, DN lowest {} median {} highest {}, {} saturated\n",
               exposure.pixels.width_px, exposure.pixels.height_px, exposure.monochrome ? "mono" : "colour",
               exposure.exposure_s ? fmt::format("{:g} s", *exposure.exposure_s) : "unknown",
               exposure.gain_db ? fmt::format("{:g} dB", *exposure.gain_db) : "unknown", sorted.front(),
               sorted[sorted.size() / 2], sorted.back(), saturated);
  }
}

Bracket take(FrameSource& source, std::stop_token stop) {
  auto bracket = source.next(stop);
  if (!bracket) throw IoError(source.name() + ": no picture (stopped, or the source has no more)");
  return std::move(*bracket);
}

void complain(const Bracket& bracket, int bit_depth) {
  if (!bracket.fault.empty()) fmt::print("WRONG     {}\n", bracket.fault);
  const CheckResult check = FrameChecker({.bit_depth = bit_depth}).check(bracket);
  if (check.fault != Fault::none)
    fmt::print("WRONG     {}\n          {}\n", check.message, fault_info(check.fault).meaning);
  const bool saturated = !bracket.exposures.front().pixels.pixels.empty() && bracket.exposures.size() == 1 &&
                         std::ranges::max(bracket.exposures.front().pixels.pixels) >= (1 << bit_depth) - 1;
  if (saturated)
    fmt::print("note      Lamps are saturated: use a bracket with shorter exposures where the camera can.\n");
  if (!SystemClock().synchronised())
    fmt::print("note      {}\n", fault_info(Fault::clock_unsynchronised).meaning);
}

void probe(const ProbeOptions& options, std::stop_token stop) {
  const auto source = open_source(options.source);
  const SourceInfo info = source->describe(stop);
  describe(*source, info);
  std::vector<double> seconds;
  Bracket bracket;
  for (int i = 0; i < 4; ++i) {
    const auto began = SteadyClock::now();
    Bracket one = take(*source, stop);
    seconds.push_back(std::chrono::duration<double>(SteadyClock::now() - began).count());
    if (i == 0) bracket = std::move(one);
    if (options.source.url.starts_with("archive:") || options.source.url.starts_with("watch:")) break;
  }
  fmt::print("latency   {:.3f} s for the first bracket", seconds.front());
  if (seconds.size() > 1) {
    std::ranges::sort(seconds.begin() + 1, seconds.end());
    fmt::print(", {:.3f} s for the next ones (at most {:.2f} brackets/s)", seconds[seconds.size() / 2],
               1 / seconds[seconds.size() / 2]);
  }
  fmt::print("\n");
  if (bracket.exposures.empty()) throw DataError(source->name() + ": " + bracket.fault);
  const int bit_depth = bit_depth_of(info, bracket);
  tell_exposures(bracket, bit_depth);
  complain(bracket, bit_depth);
  if (!options.output.empty()) save(bracket, bit_depth, options.output);
}

void run(ProbeOptions options) {
  options.source.frame_timeout =
      std::chrono::milliseconds(static_cast<std::int64_t>(options.timeout_s * 1000));
  std::ranges::sort(options.exposures_s);
  for (const double exposure_s : options.exposures_s) options.source.bracket.push_back({exposure_s});
  StopOnSignal signals;
  try {
    if (options.source.url == "libcamera:") return list_cameras();
    probe(options, signals.token());
  } catch (const SourceError& error) {
    throw IoError(fmt::format("{}: {}\n  {}", to_string(error.fault()), error.what(),
                              fault_info(error.fault()).meaning));
  }
}

}  // namespace

void add_probe(CLI::App& program) {
  CLI::App* command = program.add_subcommand(
      "probe", "Open a camera as the daemon would, tell what it is and what is wrong, and save one bracket");
  auto options = std::make_shared<ProbeOptions>();
  command
      ->add_option("SOURCE", options->source.url,
                   "http(s)://... (snapshot), mjpeg+http(s)://..., rtsp://..., v4l2:DEVICE, "
                   "libcamera:ID (libcamera: alone lists them), watch:FOLDER or archive:PATH")
      ->required();
  command->add_option("--credentials", options->source.credentials_file, "File with one line USER:PASSWORD");
  command->add_option("--ca", options->source.ca_file,
                      "PEM file of the CA that signed the camera's certificate");
  command->add_option("--format", options->source.pixel_format, "Pixel format (FourCC) wanted of a device");
  command->add_option("--width", options->source.width_px, "Width wanted of a device")
      ->check(CLI::Range(1, 65535));
  command->add_option("--height", options->source.height_px, "Height wanted of a device")
      ->check(CLI::Range(1, 65535));
  command
      ->add_option("--exposure", options->exposures_s, "Exposures of the bracket in seconds, comma between")
      ->delimiter(',')
      ->check(CLI::PositiveNumber);
  command->add_option("--timeout", options->timeout_s, "Seconds to wait for a bracket")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--output", options->output, "Save the bracket as an archive in this new folder");
  command->footer(
      "Example:\n  lampglow probe v4l2:/dev/v4l/by-path/pci-0000:00:14.0-usb-0:3:1.0-video-index0 "
      "--exposure 0.002,0.02,0.2 --output first-look");
  command->callback([options] { run(*options); });
}

}  // namespace lampglow::daemon
