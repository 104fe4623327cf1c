#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "daemon/commands/calibrate_day.h"
#include "daemon/commands/calibrate_night.h"
#include "daemon/commands/commands.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/sources/truth.h"

namespace lampglow::daemon {
namespace {

struct Arguments {
  std::string archive, truth, site, out;
};

// What was there before the first calibration is kept beside it; later ones leave that copy alone.
void keep_original(const std::filesystem::path& site_file) {
  std::filesystem::path original = site_file;
  original += ".orig";
  if (!std::filesystem::exists(site_file) || std::filesystem::exists(original)) return;
  std::error_code error;
  std::filesystem::copy_file(site_file, original, error);
  if (error)
    throw IoError("cannot keep a copy of " + site_file.string() + ": " + error.message() +
                  "; nothing was written");
  fmt::print("{} kept as it was\n", original.string());
}

void calibrate(const Arguments& arguments) {
  const std::filesystem::path archive = arguments.archive;
  const std::filesystem::path site_file =
      arguments.site.empty() ? archive / "site.toml" : std::filesystem::path(arguments.site);
  Site site = read_site_file(site_file);
  const std::vector<Truth> truths =
      read_truth(arguments.truth.empty() ? archive / "truth.csv" : std::filesystem::path(arguments.truth));
  const DayCalibrationResult day = calibrate_day(archive, truths, site);
  const NightCalibrationResult night = calibrate_night(archive, truths, site);
  fmt::print("{}{}", day.report, night.report);
  if (!day.learned && !night.learned)
    throw DataError("nothing could be learned from " + archive.string() + "; nothing was written");
  const std::filesystem::path out = arguments.out.empty() ? site_file : std::filesystem::path(arguments.out);
  keep_original(out);
  write_site_file(out, site);
  fmt::print("{} written\n", out.string());
}

}  // namespace

void add_calibrate(CLI::App& program) {
  CLI::App* command =
      program.add_subcommand("calibrate", "Learn distances and strengths from a period of known visibility");
  auto arguments = std::make_shared<Arguments>();
  command->add_option("ARCHIVE", arguments->archive, "Folder with site.toml, frames.csv and images/")
      ->required()
      ->check(CLI::ExistingDirectory);
  command->add_option("--truth", arguments->truth, "What a sensor said; default ARCHIVE/truth.csv")
      ->check(CLI::ExistingFile);
  command
      ->add_option("--site", arguments->site, "Another site file than ARCHIVE/site.toml to read and to write")
      ->check(CLI::ExistingFile);
  command->add_option(
      "--out", arguments->out,
      "Write the site file here instead of over the one read. A file that is written over is kept "
      "as FILE.orig");
  command->footer("Example:\n  lampglow calibrate ARCHIVE --truth ARCHIVE/truth.csv");
  command->callback([arguments] { calibrate(*arguments); });
}

}  // namespace lampglow::daemon
