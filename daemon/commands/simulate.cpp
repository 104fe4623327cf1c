#include "daemon/simulation/simulate.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <memory>
#include <thread>

#include "daemon/commands/commands.h"
#include "daemon/errors.h"
#include "daemon/replay/stop_on_signal.h"

namespace lampglow::daemon {

namespace {

namespace fs = std::filesystem;
using simulation::Events;
using simulation::Luminaire;
using simulation::NightOptions;
using simulation::Nuisances;
using simulation::Style;

struct SimulateArguments {
  NightOptions night;
  simulation::SimulationRun run;
  std::vector<std::string> without, with;
  bool day = false, night_too = false;
};

const std::map<std::string, Style> kStyles = {{"bracket", Style::bracket}, {"webcam", Style::webcam}};
const std::map<std::string, Luminaire> kLuminaires = {
    {"even", Luminaire::even}, {"cutoff", Luminaire::cutoff}, {"mixed", Luminaire::mixed}};
const std::map<std::string, bool Nuisances::*> kNuisances = {
    {"gain-drift", &Nuisances::gain_drift},
    {"lamp-drift", &Nuisances::lamp_drift},
    {"dimming", &Nuisances::dimming},
    {"outages", &Nuisances::outages},
    {"shake", &Nuisances::shake},
    {"cars", &Nuisances::cars},
    {"stray-lights", &Nuisances::stray_lights},
    {"hot-pixels", &Nuisances::hot_pixels},
};

const std::map<std::string, bool Events::*> kEvents = {
    {"rain-on-window", &Events::rain_on_window},
    {"shadows", &Events::shadows},
    {"snow", &Events::snow},
};

std::vector<std::string> event_names() {
  std::vector<std::string> names;
  for (const auto& [name, member] : kEvents) names.push_back(name);
  return names;
}

std::vector<std::string> nuisance_names() {
  std::vector<std::string> names = {"all"};
  for (const auto& [name, member] : kNuisances) names.push_back(name);
  return names;
}

void switch_off(Nuisances& nuisances, const std::vector<std::string>& names) {
  for (const std::string& name : names) {
    for (const auto& [known, member] : kNuisances) {
      if (name == "all" || name == known) nuisances.*member = false;
    }
  }
}

void refuse_bad_combinations(const SimulateArguments& arguments) {
  const NightOptions& night = arguments.night;
  if (night.nearest_m >= night.farthest_m) {
    throw UsageError("simulate: --nearest must be less than --farthest");
  }
  if (night.mor_min_m >= night.mor_max_m) throw UsageError("simulate: --mor-min must be less than --mor-max");
  if (night.targets_m.size() > 8) throw UsageError("simulate: --targets takes up to 8 distances");
  const int lamps = night.distances_m.empty() ? night.lamps : static_cast<int>(night.distances_m.size());
  for (const std::string& id : night.catalogue) {
    bool known = false;
    for (int i = 1; i <= lamps; ++i) known = known || id == "L" + std::to_string(i);
    if (!known)
      throw UsageError("simulate: --catalogue: no lamp " + id + "; expected L1 to L" + std::to_string(lamps));
  }
  if (night.nights > 1 && night.hours != simulation::Hours::night)
    throw UsageError("simulate: --nights is for nights alone, without --day");
  if (!arguments.with.empty() && night.hours == simulation::Hours::night)
    throw UsageError("simulate: --with is for the day: it needs --day");
  if (night.clear_nights > 0 && night.mor_max_m <= 12000)
    throw UsageError("simulate: --clear-nights needs a --mor-max above 12000");
  const fs::path& directory = arguments.run.directory;
  std::error_code error;
  if (fs::exists(directory, error) && !fs::is_directory(directory, error)) {
    throw UsageError("simulate: " + directory.string() + " is a file; expected a directory");
  }
  if (fs::exists(directory, error) && !fs::is_empty(directory, error)) {
    throw UsageError("simulate: " + directory.string() + " is not empty; nothing was written");
  }
}

// A bar on a terminal; silence elsewhere.
void show_progress(const std::string& stage, int done, int of) {
  if (!isatty(STDERR_FILENO)) return;
  const int filled = 40 * done / of;
  fmt::print(stderr, "\r{:18} [{}{}] {}/{} ", stage, std::string(static_cast<size_t>(filled), '#'),
             std::string(static_cast<size_t>(40 - filled), '.'), done, of);
  if (done == of) fmt::print(stderr, "\n");
}

void run_simulate(SimulateArguments& arguments) {
  switch_off(arguments.night.nuisances, arguments.without);
  if (arguments.day)
    arguments.night.hours = arguments.night_too ? simulation::Hours::both : simulation::Hours::day;
  for (const std::string& name : arguments.with) arguments.night.events.*kEvents.at(name) = true;
  refuse_bad_combinations(arguments);
  const StopOnSignal stop;
  int written = 0;
  try {
    written = simulation::simulate_night(arguments.night, arguments.run, show_progress, stop.token());
  } catch (const fs::filesystem_error& error) {
    throw IoError(std::string("simulate: ") + error.what());
  }
  if (stop.token().stop_requested())
    fmt::print(stderr, "lampglow: stopped; an archive of the frames that were done is kept\n");
  fmt::print("{}: {} observations, {}, seed {}\n", arguments.run.directory.string(), written,
             arguments.night.style == Style::bracket ? "brackets of three exposures" : "webcam pictures",
             arguments.night.seed);
}

// Several nights in a row, and what wears lamps and window over them.
void add_nights(CLI::App& command, NightOptions& night) {
  command.add_option("--nights", night.nights, "Spread the frames over so many nights")
      ->check(CLI::Range(1, 60))
      ->capture_default_str();
  command
      .add_option("--clear-nights", night.clear_nights, "The first so many of them have nothing below 12 km")
      ->check(CLI::Range(0, 60))
      ->capture_default_str();
  command
      .add_option("--ageing", night.ageing,
                  "Part of their light that the lamps lose from first to last frame")
      ->check(CLI::Range(0.0, 0.9))
      ->capture_default_str();
  command
      .add_option("--dirt", night.dirt, "Part of all light that the window loses from first to last frame")
      ->check(CLI::Range(0.0, 0.9))
      ->capture_default_str();
}

void add_lamps(CLI::App& command, NightOptions& night) {
  command.add_option("--lamps", night.lamps, "Lamps of the catalogue")
      ->check(CLI::Range(1, 40))
      ->capture_default_str();
  command.add_option("--nearest", night.nearest_m, "Distance of the nearest lamp [m]")
      ->check(CLI::Range(10.0, 10000.0))
      ->capture_default_str();
  command.add_option("--farthest", night.farthest_m, "Distance of the farthest lamp [m]")
      ->check(CLI::Range(10.0, 10000.0))
      ->capture_default_str();
  command
      .add_option("--distances", night.distances_m, "Distances of all lamps [m], instead of the three above")
      ->delimiter(',')
      ->check(CLI::Range(10.0, 10000.0));
  command.add_option("--catalogue", night.catalogue, "Only these lamps (L1,L2,...) are listed in site.toml")
      ->delimiter(',');
}

}  // namespace

void add_simulate(CLI::App& program) {
  auto arguments = std::make_shared<SimulateArguments>();
  arguments->run.workers = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  CLI::App* command =
      program.add_subcommand("simulate", "Write an archive of a simulated night, with its truth");
  NightOptions& night = arguments->night;
  command->add_option("OUT", arguments->run.directory, "Directory of the archive; new or empty")->required();
  command->add_option("--seed", night.seed, "The same seed gives the same bytes")->capture_default_str();
  command->add_option("--frames", night.frames, "Observations; two clear references come on top")
      ->check(CLI::Range(1, 2000))
      ->capture_default_str();
  command
      ->add_option_function<std::string>(
          "--style", [&night](const std::string& name) { night.style = kStyles.at(name); },
          "bracket: 12 bit, three exposures; webcam: 8-bit sRGB JPEG, saturated")
      ->check(CLI::IsMember({"bracket", "webcam"}))
      ->default_str("bracket");
  command
      ->add_option_function<std::string>(
          "--luminaire", [&night](const std::string& name) { night.luminaire = kLuminaires.at(name); },
          "even: the same light all round; cutoff: a disc that faces down over a ground of albedo 0.2 "
          "(slow); "
          "mixed: every second lamp cut-off")
      ->check(CLI::IsMember({"even", "cutoff", "mixed"}))
      ->default_str("even");
  command->add_flag("--day", arguments->day, "By day: dark targets against the horizon sky");
  command->add_flag("--night", arguments->night_too, "With --day: the whole 24 hours");
  command->add_option("--targets", night.targets_m, "Distances of the day's targets [m]")
      ->delimiter(',')
      ->check(CLI::Range(30.0, 20000.0))
      ->capture_default_str();
  add_lamps(*command, night);
  command->add_option("--mor-min", night.mor_min_m, "Least visibility of the night [m]")
      ->check(CLI::Range(20.0, 50000.0))
      ->capture_default_str();
  command->add_option("--mor-max", night.mor_max_m, "Greatest visibility of the night [m]")
      ->check(CLI::Range(20.0, 50000.0))
      ->capture_default_str();
  add_nights(*command, night);
  command->add_option("--without", arguments->without, "Nuisances to leave out, or all")
      ->delimiter(',')
      ->check(CLI::IsMember(nuisance_names()));
  command->add_option("--with", arguments->with, "What comes over the station for two fifths of the day")
      ->delimiter(',')
      ->check(CLI::IsMember(event_names()));
  command->add_option("--photons", arguments->run.photons, "Photons that are counted for each q of the night")
      ->check(CLI::Range(std::uint64_t{1000}, std::uint64_t{1000000000}))
      ->capture_default_str();
  command->add_option("--workers", arguments->run.workers, "Threads; the result does not depend on them")
      ->check(CLI::Range(1, 256))
      ->capture_default_str();
  command->footer(
      "Examples:\n  lampglow simulate night --seed 7\n"
      "  lampglow simulate webcam --style webcam --frames 20\n"
      "  lampglow simulate day --day\n"
      "  lampglow simulate wet --day --with rain-on-window\n"
      "  lampglow simulate 24h --day --night --frames 96\n"
      "  lampglow simulate alone --distances 60,100,180,500 --catalogue L3 --mor-min 150 --mor-max 1500");
  command->callback([arguments] { run_simulate(*arguments); });
}

}  // namespace lampglow::daemon
