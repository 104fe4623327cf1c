#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/config/site_file.h"

namespace lampglow::daemon {
namespace {

void describe_site(const Site& site) {
  const auto with_distance = [](const auto& items) {
    int count = 0;
    for (const auto& item : items) count += item.distance_m.has_value();
    return count;
  };
  fmt::print("site \"{}\": camera of {}x{} pixels, {} bits\n", site.name, site.camera.width_px,
             site.camera.height_px, site.camera.bit_depth);
  fmt::print("{} lights, {} of them with a distance\n", site.lights.size(), with_distance(site.lights));
  fmt::print("{} day targets, {} of them with a distance\n", site.targets.size(),
             with_distance(site.targets));
  if (!site.camera.focal_length_px)
    fmt::print("focal_length_px is not given: the glow's shape cannot be used\n");
  if (!site.latitude_deg || !site.longitude_deg)
    fmt::print("latitude and longitude are not given: day and night are told from the picture alone\n");
}

}  // namespace

void add_check_config(CLI::App& program) {
  CLI::App* command =
      program.add_subcommand("check-config", "Read a site file and tell everything wrong in it");
  auto file = std::make_shared<std::string>();
  command->add_option("FILE", *file, "The site file")->required();
  command->footer("Example:\n  lampglow check-config archive/site.toml");
  command->callback([file] { describe_site(read_site_file(*file)); });
}

}  // namespace lampglow::daemon
