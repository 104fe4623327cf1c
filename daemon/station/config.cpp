#include "daemon/station/config.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <set>

#include "daemon/config/config_file.h"
#include "daemon/config/files.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"

namespace lampglow::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

milliseconds duration_ms(double s) {
  return milliseconds(static_cast<std::int64_t>(s * 1000));
}

bool good_name(const std::string& name) {
  return !name.empty() && name.size() <= 64 && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '-' || c == '_';
  });
}

std::string checked_name(ConfigTable& table, const std::string& key, const std::string& name) {
  if (!good_name(name))
    table.problem(key, fmt::format("expected up to 64 letters, digits, '-' or '_', got \"{}\"", name));
  return name;
}

std::filesystem::path relative_to(const std::filesystem::path& folder, const std::string& path) {
  return path.empty() || std::filesystem::path(path).is_absolute() ? std::filesystem::path(path)
                                                                   : folder / path;
}

void read_exposures(ConfigTable& table, SourceOptions& source) {
  const auto exposures = table.numbers("exposures_s", 0, kPositive);
  if (!exposures) return;
  for (const double exposure_s : *exposures) source.bracket.push_back({exposure_s, {}});
  std::sort(source.bracket.begin(), source.bracket.end(),
            [](const auto& a, const auto& b) { return a.exposure_s < b.exposure_s; });
}

SourceOptions read_source(ConfigTable table, const std::filesystem::path& folder) {
  SourceOptions source;
  source.url = table.required_text("url");
  if (const std::string wrong = url_problem(source.url); !source.url.empty() && !wrong.empty())
    table.problem("url", fmt::format("{}, got \"{}\"", wrong, redacted_url(source.url)));
  for (const std::string_view kind : {"archive:", "watch:"})
    if (source.url.starts_with(kind))
      source.url = std::string(kind) + relative_to(folder, source.url.substr(kind.size())).string();
  source.credentials_file = table.text("credentials_file").value_or("");
  source.ca_file = table.text("ca_file").value_or("");
  if (const auto v = table.number("connect_timeout_s", {0.1, 300})) source.connect_timeout = duration_ms(*v);
  if (const auto v = table.number("frame_timeout_s", {0.1, 600})) source.frame_timeout = duration_ms(*v);
  if (const auto v = table.number("stall_timeout_s", {0.1, 300})) source.stall_timeout = duration_ms(*v);
  source.stay_connected = table.boolean("stay_connected").value_or(false);
  source.pixel_format = table.text("pixel_format").value_or("");
  source.width_px = static_cast<int>(table.integer("width_px", 0, 65535).value_or(0));
  source.height_px = static_cast<int>(table.integer("height_px", 0, 65535).value_or(0));
  if (const auto v = table.integer("gain_step", 0, 1 << 30)) source.gain_step = static_cast<int>(*v);
  source.gain_db_per_step = table.number("gain_db_per_step", kPositive);
  source.exposure_unit_s = table.number("exposure_unit_s", kPositive);
  read_exposures(table, source);
  return source;
}

ScheduleOptions read_schedule(std::optional<ConfigTable> table) {
  ScheduleOptions schedule;
  if (!table) return schedule;
  const auto interval = [&](const char* key) { return table->integer(key, 1, 86400); };
  if (const auto v = interval("interval_s")) schedule.interval = seconds(*v);
  if (const auto v = interval("in_fog_s")) schedule.in_fog = seconds(*v);
  if (const auto v = interval("in_clear_s")) schedule.in_clear = seconds(*v);
  schedule.fog_mor_m = table->number("fog_mor_m", kPositive).value_or(schedule.fog_mor_m);
  schedule.clear_mor_m = table->number("clear_mor_m", kPositive).value_or(schedule.clear_mor_m);
  schedule.night_below_deg = table->number("night_below_deg", {-90, 90}).value_or(schedule.night_below_deg);
  if (const auto v = table->one_of("when", {"night", "day", "both"}))
    schedule.part = *v == "night" ? DayPart::night : *v == "day" ? DayPart::day : DayPart::both;
  return schedule;
}

// [reference]: how nights teach. `relearn = false` leaves the reference as its brackets gave it.
std::optional<inference::RelearnOptions> read_relearn(std::optional<ConfigTable> table) {
  inference::RelearnOptions relearn;
  if (!table) return relearn;
  const bool wanted = table->boolean("relearn").value_or(true);
  const auto number = [&](const char* key, double& value, NumberRange range) {
    value = table->number(key, range).value_or(value);
  };
  number("clear_mor_m", relearn.clear_mor_m, {2000, 100000});
  number("least_hours", relearn.least_hours, {0.5, 12});
  number("step_part", relearn.step_part, {0.01, 1});
  number("step_cap", relearn.step_cap, {0.001, 0.2});
  if (!wanted) return std::nullopt;
  return relearn;
}

std::string fingerprint_of(const CameraConfig& camera) {
  const SourceOptions& s = camera.source;
  const ScheduleOptions& t = camera.schedule;
  std::string text =
      format_site(camera.site) +
      fmt::format("{}|{}|{}|{}|{}|{}|{}|{}|{}|{}|{}|{}|{}\n", s.url, s.credentials_file, s.ca_file,
                  s.connect_timeout.count(), s.frame_timeout.count(), s.stall_timeout.count(),
                  s.stay_connected, s.pixel_format, s.width_px, s.height_px, s.gain_step.value_or(-1),
                  s.gain_db_per_step.value_or(-1), s.exposure_unit_s.value_or(-1));
  for (const ExposureSetting& exposure : s.bracket) text += fmt::format("{}|", exposure.exposure_s);
  const auto count = [](const std::optional<seconds>& value) { return value ? value->count() : -1; };
  return text +
         fmt::format("{}|{}|{}|{}|{}|{}|{}|{}|{}", t.interval.count(), count(t.in_fog), count(t.in_clear),
                     t.fog_mor_m, t.clear_mor_m, static_cast<int>(t.part), t.night_below_deg,
                     camera.adapt_exposure, camera.reference_archive.string()) +
         (camera.relearn
              ? fmt::format("|{}|{}|{}|{}", camera.relearn->clear_mor_m, camera.relearn->least_hours,
                            camera.relearn->step_part, camera.relearn->step_cap)
              : "|-");
}

CameraConfig read_camera_parts(ConfigTable& table, const std::filesystem::path& folder) {
  CameraConfig camera;
  camera.source = read_source(table.required_table("source"), folder);
  camera.schedule = read_schedule(table.table("schedule"));
  camera.adapt_exposure = table.boolean("adapt_exposure").value_or(true);
  camera.relearn = read_relearn(table.table("reference"));
  camera.reference_archive = relative_to(folder, table.text("reference_archive").value_or(""));
  if (camera.reference_archive.empty() && camera.source.url.starts_with("archive:"))
    camera.reference_archive = camera.source.url.substr(8);
  return camera;
}

// One camera: [site], [camera], [[light]], [[target]], [source], [schedule] in the file itself.
// Several: [[cameras]] with name, site (a site file), [cameras.source], [cameras.schedule].
std::vector<CameraConfig> read_cameras(ConfigTable& root, const std::filesystem::path& folder) {
  std::vector<CameraConfig> cameras;
  if (!root.has("cameras")) {
    CameraConfig camera = read_camera_parts(root, folder);
    if (root.has("site_file"))
      camera.site = read_site_file(relative_to(folder, root.required_text("site_file")));
    else
      camera.site = read_site_tables(root, folder);
    camera.name = root.text("name").value_or(camera.site.name);
    checked_name(root, "name", camera.name);
    cameras.push_back(std::move(camera));
  }
  for (ConfigTable& table : root.tables("cameras")) {
    CameraConfig camera = read_camera_parts(table, folder);
    camera.name = checked_name(table, "name", table.required_text("name"));
    const std::string site = table.required_text("site_file");
    if (!site.empty()) camera.site = read_site_file(relative_to(folder, site));
    for (const CameraConfig& other : cameras)
      if (other.name == camera.name) table.problem("name", "another camera has this name already");
    cameras.push_back(std::move(camera));
  }
  for (CameraConfig& camera : cameras) camera.fingerprint = fingerprint_of(camera);
  return cameras;
}

void read_tokens(ConfigTable& table, StationConfig& config) {
  const auto protect = table.one_of("protect", {"nothing", "pictures", "everything"});
  if (protect == "pictures") config.access.protect = web::Protect::pictures;
  if (protect == "everything") config.access.protect = web::Protect::everything;
  config.access.token_hashes = table.texts("token_hashes").value_or(std::vector<std::string>());
  for (const std::string& hash : config.access.token_hashes)
    if (hash.size() != 64 || hash.find_first_not_of("0123456789abcdef") != std::string::npos)
      table.problem("token_hashes", "expected 64 hexadecimal digits as `lampglow token` prints them");
  if (config.access.protect != web::Protect::nothing && config.access.token_hashes.empty())
    table.problem("protect", "is of no use without token_hashes; `lampglow token` makes one");
}

void read_http(std::optional<ConfigTable> table, const std::filesystem::path& folder, StationConfig& config) {
  if (!table) return;
  web::ServerOptions& http = config.http;
  http.address = table->text("address").value_or(http.address);
  http.port = static_cast<unsigned short>(table->integer("port", 0, 65535).value_or(http.port));
  http.tls.certificate = relative_to(folder, table->text("tls_certificate").value_or(""));
  http.tls.key = relative_to(folder, table->text("tls_key").value_or(""));
  if (http.tls.certificate.empty() != http.tls.key.empty())
    table->problem("tls_key", "tls_certificate and tls_key belong together");
  const auto count = [&](const char* key, int& value, int low, int high) {
    value = static_cast<int>(table->integer(key, low, high).value_or(value));
  };
  count("max_connections", http.max_connections, 1, 60000);
  count("max_connections_per_address", http.max_connections_per_address, 1, 60000);
  count("max_header_bytes", http.max_header_bytes, 1024, 65536);
  read_tokens(*table, config);
}

void read_keep(std::optional<ConfigTable> table, StationConfig& config) {
  if (!table) return;
  const auto days = [&](const char* key, int& value) {
    value = static_cast<int>(table->integer(key, 0, 36500).value_or(value));
  };
  storage::Retention& keep = config.retention;
  days("frames_days", keep.frames_days);
  days("fits_days", keep.fits_days);
  days("ring_profiles_days", keep.ring_profiles_days);
  days("one_minute_days", keep.one_minute_days);
  days("ten_minutes_days", keep.ten_minutes_days);
  days("hours_days", keep.hours_days);
  days("events_days", keep.events_days);
  config.backups_kept = static_cast<int>(table->integer("backups", 0, 1000).value_or(config.backups_kept));
  config.backup_hour_utc =
      static_cast<int>(table->integer("backup_hour_utc", 0, 23).value_or(config.backup_hour_utc));
  if (config.backups_kept == 0) config.backup_hour_utc = -1;
  if (const auto minutes = table->number("checkpoint_minutes", {0.1, 1440}))
    config.checkpoint_every =
        std::chrono::round<seconds>(std::chrono::duration<double, std::ratio<60>>(*minutes));
}

void read_pictures(std::optional<ConfigTable> table, PictureOptions& pictures) {
  if (!table) return;
  pictures.hourly = table->boolean("hourly").value_or(true);
  pictures.fog_onset = table->boolean("fog_onset").value_or(true);
  if (const auto megabytes = table->integer("max_megabytes", 0, 100'000'000))
    pictures.max_bytes = *megabytes * 1'000'000;
  pictures.jpeg_quality =
      static_cast<int>(table->integer("jpeg_quality", 10, 100).value_or(pictures.jpeg_quality));
}

std::filesystem::path default_data_directory() {
  const char* given = std::getenv("STATE_DIRECTORY");  // systemd's StateDirectory=
  return given && *given ? given : "/var/lib/lampglow";
}

}  // namespace

StationConfig read_station_config(const std::filesystem::path& file) {
  return parse_station_config(read_text_file(file), file);
}

StationConfig parse_station_config(std::string_view text, const std::filesystem::path& file) {
  StationConfig config;
  config.file = file;
  const std::filesystem::path folder = file.parent_path();
  ConfigFile source(text, file.string());
  ConfigTable root = source.root();
  config.data_directory = default_data_directory();
  if (auto station = root.table("station")) {
    if (const auto data = station->text("data_directory")) config.data_directory = relative_to(folder, *data);
    config.workers = static_cast<std::size_t>(station->integer("workers", 1, 1024).value_or(0));
    config.stale_after =
        seconds(station->integer("stale_after_s", 10, 86400).value_or(config.stale_after.count()));
  }
  read_http(root.table("http"), folder, config);
  read_keep(root.table("keep"), config);
  read_pictures(root.table("pictures"), config.pictures);
  config.cameras = read_cameras(root, folder);
  source.finish();
  return config;
}

std::vector<std::string> needs_restart(const StationConfig& running, const StationConfig& wanted) {
  std::vector<std::string> out;
  const auto differs = [&out](const char* key, const auto& a, const auto& b) {
    if (a != b) out.emplace_back(key);
  };
  differs("station.data_directory", running.data_directory, wanted.data_directory);
  differs("station.workers", running.workers, wanted.workers);
  differs("station.stale_after_s", running.stale_after, wanted.stale_after);
  differs("http.address", running.http.address, wanted.http.address);
  differs("http.port", running.http.port, wanted.http.port);
  differs("http.tls_certificate", running.http.tls.certificate.empty(), wanted.http.tls.certificate.empty());
  differs("http.max_connections", running.http.max_connections, wanted.http.max_connections);
  differs("http.max_connections_per_address", running.http.max_connections_per_address,
          wanted.http.max_connections_per_address);
  differs("http.max_header_bytes", running.http.max_header_bytes, wanted.http.max_header_bytes);
  return out;
}

}  // namespace lampglow::daemon
