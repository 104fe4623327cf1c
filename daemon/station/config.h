// The configuration of `lampglow serve`: one TOML file, read strictly. docs/configuration.md explains every
// key.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/schedule/schedule.h"
#include "daemon/sources/open_source.h"
#include "estimator/inference/relearn.h"
#include "estimator/site.h"
#include "storage/maintenance.h"
#include "web/server.h"

namespace lampglow::daemon {

struct CameraConfig {
  std::string name;  // in URLs, the database, metrics: letters, digits, '-', '_'
  Site site;
  SourceOptions source;
  ScheduleOptions schedule;
  bool adapt_exposure = true;
  // An archive whose clear_reference brackets teach the clear reference; empty: an archive: source's own,
  // else none, and every frame says no_reference.
  std::filesystem::path reference_archive;
  // Clear nights teach the reference slowly; empty: it stays as the brackets gave it. On by default, for
  // within a year lamps and window lose more than the fit's prior of 12 % allows for.
  std::optional<inference::RelearnOptions> relearn = inference::RelearnOptions{};
  // All settings as text: two configurations of a camera are the same if these are.
  std::string fingerprint;
};

struct PictureOptions {
  bool hourly = true;
  bool fog_onset = true;
  std::int64_t max_bytes = std::int64_t{2} << 30;
  int jpeg_quality = 85;
};

struct StationConfig {
  std::filesystem::path file;
  std::filesystem::path data_directory;  // database, pictures, backups
  std::size_t workers = 0;               // 0: the cores
  std::chrono::seconds stale_after{300};
  std::vector<CameraConfig> cameras;
  web::ServerOptions http;
  web::Access access;
  storage::Retention retention;
  PictureOptions pictures;
  std::chrono::seconds checkpoint_every{600};  // what a power cut can lose
  int backup_hour_utc = 3;                     // -1: no backups
  int backups_kept = 7;

  std::filesystem::path database() const { return data_directory / "lampglow.db"; }
  std::filesystem::path picture_directory() const { return data_directory / "pictures"; }
  std::filesystem::path backup_directory() const { return data_directory / "backups"; }
};

// Throws ConfigError (exit 78) with every problem, IoError where a file cannot be read. Opens no source.
StationConfig read_station_config(const std::filesystem::path& file);
StationConfig parse_station_config(std::string_view text, const std::filesystem::path& file);

// What differs between two configurations that only a restart can change: the keys, for a message.
std::vector<std::string> needs_restart(const StationConfig& running, const StationConfig& wanted);

}  // namespace lampglow::daemon
