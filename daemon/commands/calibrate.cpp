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
  std::string archive, truth, out;
};

void calibrate(const Arguments& arguments) {
  const std::filesystem::path archive = arguments.archive;
  const std::filesystem::path site_file = archive / "site.toml";
  Site site = read_site_file(site_file);
  const std::vector<Truth> truths =
      read_truth(arguments.truth.empty() ? archive / "truth.csv" : std::filesystem::path(arguments.truth));
  const DayCalibrationResult day = calibrate_day(archive, truths, site);
  const NightCalibrationResult night = calibrate_night(archive, truths, site);
  fmt::print("{}{}", day.report, night.report);
  if (!day.learned && !night.learned)
    throw DataError("nothing could be learned from " + archive.string() + "; the site file is as it was");
  const std::filesystem::path out = arguments.out.empty() ? site_file : std::filesystem::path(arguments.out);
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
  command->add_option("--out", arguments->out, "Write the site file here instead of over ARCHIVE/site.toml");
  command->footer("Example:\n  lampglow calibrate ARCHIVE --truth ARCHIVE/truth.csv");
  command->callback([arguments] { calibrate(*arguments); });
}

}  // namespace lampglow::daemon
