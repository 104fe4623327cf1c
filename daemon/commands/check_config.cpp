#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/config/site_file.h"
#include "daemon/station/config.h"

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

// The daemon's configuration holds a site's tables too, but also where the frames come from.
void check(const std::string& file) {
  ConfigFile parsed = ConfigFile::read(file);
  bool is_station = false;
  for (const char* key :
       {"source", "cameras", "site_file", "schedule", "station", "http", "keep", "pictures"})
    is_station = is_station || parsed.root().has(key);
  if (!is_station) return describe_site(read_site_file(file));
  const StationConfig station = read_station_config(file);
  fmt::print("station with {} cameras, HTTP on {}:{}\n", station.cameras.size(), station.http.address,
             station.http.port);
  for (const CameraConfig& camera : station.cameras) {
    fmt::print("camera {}: ", camera.name);
    describe_site(camera.site);
  }
}

}  // namespace

void add_check_config(CLI::App& program) {
  CLI::App* command = program.add_subcommand(
      "check-config", "Read a site file or the daemon's configuration and tell everything wrong in it");
  auto file = std::make_shared<std::string>();
  command->add_option("FILE", *file, "The site file or configuration")->required();
  command->footer(
      "Example:\n  lampglow check-config archive/site.toml\n  lampglow check-config "
      "/etc/lampglow/lampglow.toml");
  command->callback([file] { check(*file); });
}

}  // namespace lampglow::daemon
