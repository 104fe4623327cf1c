#include "daemon/config/site_file.h"

#include <fmt/format.h>

#include <cmath>
#include <set>

#include "daemon/config/csv.h"
#include "daemon/config/files.h"
#include "daemon/config/problems.h"
#include "daemon/errors.h"
#include "estimator/photometry/vignetting.h"

namespace lampglow::daemon {
namespace {

constexpr int kMaxSide_px = 32767;

// Relative, and without any step upwards.
bool stays_inside(const std::filesystem::path& path) {
  if (path.empty() || path.is_absolute()) return false;
  for (const auto& part : path)
    if (part == "..") return false;
  return true;
}

Response read_response(ConfigTable& camera, int bit_depth, const std::filesystem::path& folder) {
  Response response;
  const std::string text = camera.required_text("response");
  if (text.empty() || text == "linear") return response;
  if (text == "srgb") {
    response.kind = Response::Kind::srgb;
    return response;
  }
  response.kind = Response::Kind::curve;
  if (!stays_inside(text) || std::filesystem::is_symlink(folder / text)) {
    camera.problem("response",
                   "expected \"linear\", \"srgb\" or a CSV file within the site file's folder, got " +
                       format_text(text));
    return response;
  }
  try {
    if (bit_depth >= 8) response.curve = read_response_curve(folder / text, bit_depth);
  } catch (const CommandError& error) {
    camera.problem(
        "response",
        std::string("expected \"linear\", \"srgb\" or a file with a measured curve; ") + error.what());
  }
  return response;
}

// A lens that lets less than a twentieth, or more than twice, through anywhere is a mistake in the numbers.
void read_vignetting(ConfigTable& table, Camera& camera) {
  constexpr std::size_t kMost = 4;
  constexpr double kLeastTransmission = 0.05, kGreatestTransmission = 2;
  constexpr int kSteps = 200;
  const auto numbers = table.numbers("vignetting", 0);
  if (!numbers) return;
  if (numbers->empty() || numbers->size() > kMost) {
    table.problem("vignetting", fmt::format("expected 1 to {} numbers, got {}", kMost, numbers->size()));
    return;
  }
  camera.vignetting = *numbers;
  if (camera.width_px <= 0 || camera.height_px <= 0) return;
  for (int i = 0; i <= kSteps; ++i) {
    const double rho = photometry::farthest_rho(camera) * i / kSteps;
    const double transmission = photometry::vignetting_at(camera, rho);
    if (transmission >= kLeastTransmission && transmission <= kGreatestTransmission) continue;
    table.problem(
        "vignetting",
        fmt::format("expected a transmission of {} to {} all over the picture, it is {:.3g} at {:.2f} of "
                    "half the diagonal from the principal point",
                    kLeastTransmission, kGreatestTransmission, transmission, rho));
    return;
  }
}

Camera read_camera(ConfigTable table, const std::filesystem::path& folder) {
  Camera camera;
  camera.width_px = static_cast<int>(table.required_integer("width_px", 1, kMaxSide_px));
  camera.height_px = static_cast<int>(table.required_integer("height_px", 1, kMaxSide_px));
  camera.focal_length_px = table.number("focal_length_px", kPositive);
  const auto principal = table.numbers("principal_point_px", 2);
  camera.principal_x_px = principal ? principal->at(0) : camera.width_px / 2.0;
  camera.principal_y_px = principal ? principal->at(1) : camera.height_px / 2.0;
  camera.bit_depth = static_cast<int>(table.required_integer("bit_depth", 8, 16));
  const double highest_dn = camera.bit_depth >= 8 ? std::ldexp(1.0, camera.bit_depth) - 1 : 65535.0;
  camera.black_level_dn = table.required_number("black_level_dn", {0, highest_dn});
  camera.saturation_dn = table.required_number("saturation_dn", {1, highest_dn});
  if (table.has("black_level_dn") && table.has("saturation_dn") && camera.saturation_dn > 0 &&
      camera.black_level_dn >= camera.saturation_dn)
    table.problem("black_level_dn", "expected a number below saturation_dn");
  camera.response = read_response(table, camera.bit_depth, folder);
  read_vignetting(table, camera);
  camera.read_noise_dn = table.number("read_noise_dn", kNotNegative);
  camera.gain_dn_per_electron = table.number("gain_dn_per_electron", kPositive);
  return camera;
}

NumberRange across(int side_px) {
  return {0.0, static_cast<double>(side_px > 0 ? side_px : kMaxSide_px)};
}

// An identifier stands in the database, in URLs and in CSV; so it is short and holds no spaces.
std::string read_id(ConfigTable& table, std::set<std::string>& taken) {
  std::string id = table.required_text("id");
  if (!table.has("id")) return id;
  const bool plain =
      !id.empty() && id.size() <= 64 &&
      id.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-") ==
          std::string::npos;
  if (!plain)
    table.problem("id", "expected 1 to 64 letters, digits, '_', '.' or '-', got " + format_text(id));
  else if (!taken.insert(id).second)
    table.problem("id", "expected an id of its own, " + format_text(id) + " stands twice");
  return id;
}

// With the strays' and their rings still within photometry::kMaxRings.
constexpr std::size_t kMaxLights = 800;

Light read_light(ConfigTable& table, const Camera& camera, std::set<std::string>& taken) {
  Light light;
  light.id = read_id(table, taken);
  light.x_px = table.required_number("x_px", across(camera.width_px));
  light.y_px = table.required_number("y_px", across(camera.height_px));
  light.distance_m = table.number("distance_m", kPositive);
  light.distance_sigma_m = table.number("distance_sigma_m", kNotNegative);
  return light;
}

// All keys of a learned contrast, or none of them.
std::optional<TargetContrast> read_contrast(ConfigTable& table) {
  const bool any = table.has("log_contrast") || table.has("log_contrast_sigma") || table.has("log_floor") ||
                   table.has("lighting");
  if (!any) return std::nullopt;
  TargetContrast contrast;
  contrast.log_contrast = table.required_number("log_contrast");
  contrast.log_contrast_sigma = table.required_number("log_contrast_sigma", kPositive);
  contrast.log_floor = table.required_number("log_floor");
  if (const auto lighting = table.numbers("lighting", 2))
    contrast.lighting = {lighting->at(0), lighting->at(1)};
  else if (!table.has("lighting"))
    table.problem("lighting", "is missing; expected a list of 2 numbers");
  return contrast;
}

Target read_target(ConfigTable& table, const Camera& camera, std::set<std::string>& taken) {
  Target target;
  target.id = read_id(table, taken);
  if (!table.has("box_px"))
    table.problem("box_px", "is missing; expected a list of 4 numbers: x, y, width, height");
  if (const auto box = table.numbers("box_px", 4, kNotNegative)) {
    target.x_px = box->at(0);
    target.y_px = box->at(1);
    target.width_px = box->at(2);
    target.height_px = box->at(3);
    if (target.width_px < 1 || target.height_px < 1 ||
        target.x_px + target.width_px > across(camera.width_px).high ||
        target.y_px + target.height_px > across(camera.height_px).high)
      table.problem("box_px",
                    "expected x, y, width, height of a box within the picture, at least 1 px wide and high");
  }
  target.distance_m = table.number("distance_m", kPositive);
  target.distance_sigma_m = table.number("distance_sigma_m", kNotNegative);
  target.brightness_ratio = table.number("brightness_ratio", {0, 1});
  target.brightness_ratio_sigma = table.number("brightness_ratio_sigma", kPositive);
  target.contrast = read_contrast(table);
  return target;
}

// What `calibrate` learned of the picture's patches; three lists of one length.
PatchCalibration read_patches(ConfigTable table) {
  PatchCalibration patches;
  patches.patch_px = static_cast<int>(table.required_integer("patch_px", 4, 1024));
  patches.texture = table.boolean("texture").value_or(false);
  patches.colour = table.boolean("colour").value_or(false);
  patches.log_extinction_mean = table.required_number("log_extinction_mean");
  patches.log_extinction_sigma = table.required_number("log_extinction_sigma", kPositive);
  patches.log_extinction_low = table.required_number("log_extinction_low");
  patches.log_extinction_high = table.required_number("log_extinction_high");
  for (const auto& [key, list] : {std::pair{"mean", &patches.mean}, std::pair{"scale", &patches.scale},
                                  std::pair{"weight", &patches.weight}}) {
    if (const auto numbers = table.numbers(key, 0))
      *list = *numbers;
    else if (!table.has(key))
      table.problem(key, "is missing; expected a list of numbers");
  }
  if (patches.mean.size() != patches.weight.size() || patches.scale.size() != patches.weight.size())
    table.problem("weight", "expected as many numbers as in mean and scale");
  return patches;
}

DayCalibration read_day(ConfigTable table, const Camera& camera) {
  DayCalibration day;
  if (const auto box = table.numbers("sky_box_px", 4, kNotNegative)) {
    day.sky_x_px = box->at(0);
    day.sky_y_px = box->at(1);
    day.sky_width_px = box->at(2);
    day.sky_height_px = box->at(3);
    if (day.sky_width_px < 1 || day.sky_height_px < 1 || day.sky_x_px + day.sky_width_px > camera.width_px ||
        day.sky_y_px + day.sky_height_px > camera.height_px)
      table.problem("sky_box_px",
                    "expected x, y, width, height of a box within the picture, at least 1 px wide and high");
  } else if (!table.has("sky_box_px")) {
    table.problem("sky_box_px", "is missing; expected a list of 4 numbers: x, y, width, height");
  }
  day.log_extinction_sigma = table.required_number("log_extinction_sigma", kNotNegative);
  day.independent_targets = table.required_number("independent_targets", kPositive);
  day.colour = table.boolean("colour").value_or(false);
  return day;
}

std::string line(std::string_view key, double value) {
  return fmt::format("{} = {}\n", key, format_number(value));
}

std::string line(std::string_view key, const std::optional<double>& value) {
  return value ? line(key, *value) : "";
}

std::string response_text(const Response& response, const std::string& response_file) {
  switch (response.kind) {
    case Response::Kind::linear:
      return "linear";
    case Response::Kind::srgb:
      return "srgb";
    case Response::Kind::curve:
      break;
  }
  return response_file;
}

std::string format_list(std::string_view key, const std::vector<double>& numbers) {
  std::string text = fmt::format("{} = [", key);
  for (std::size_t i = 0; i < numbers.size(); ++i)
    text += fmt::format("{}{:.6g}", i == 0 ? "" : i % 12 == 0 ? ",\n  " : ", ", numbers[i]);
  return text + "]\n";
}

std::string format_camera(const Camera& camera, const std::string& response_file) {
  std::string text = "[camera]\n";
  text += fmt::format("width_px = {}\nheight_px = {}\n", camera.width_px, camera.height_px);
  text += line("focal_length_px", camera.focal_length_px);
  text += fmt::format("principal_point_px = [{}, {}]\n", format_number(camera.principal_x_px),
                      format_number(camera.principal_y_px));
  text += fmt::format("bit_depth = {}\n", camera.bit_depth);
  text += line("black_level_dn", camera.black_level_dn);
  text += line("saturation_dn", camera.saturation_dn);
  text += fmt::format("response = {}\n", format_text(response_text(camera.response, response_file)));
  if (!camera.vignetting.empty()) text += format_list("vignetting", camera.vignetting);
  text += line("read_noise_dn", camera.read_noise_dn);
  text += line("gain_dn_per_electron", camera.gain_dn_per_electron);
  return text;
}

std::string format_patches(std::string_view name, const PatchCalibration& patches) {
  return fmt::format("[{}]\npatch_px = {}\ntexture = {}\ncolour = {}\n", name, patches.patch_px,
                     patches.texture, patches.colour) +
         line("log_extinction_mean", patches.log_extinction_mean) +
         line("log_extinction_sigma", patches.log_extinction_sigma) +
         line("log_extinction_low", patches.log_extinction_low) +
         line("log_extinction_high", patches.log_extinction_high) + format_list("mean", patches.mean) +
         format_list("scale", patches.scale) + format_list("weight", patches.weight);
}

std::string format_contrast(const TargetContrast& contrast) {
  return line("log_contrast", contrast.log_contrast) +
         line("log_contrast_sigma", contrast.log_contrast_sigma) + line("log_floor", contrast.log_floor) +
         fmt::format("lighting = [{}, {}]\n", format_number(contrast.lighting[0]),
                     format_number(contrast.lighting[1]));
}

std::string format_day(const DayCalibration& day) {
  return fmt::format("[day]\nsky_box_px = [{}, {}, {}, {}]\n", format_number(day.sky_x_px),
                     format_number(day.sky_y_px), format_number(day.sky_width_px),
                     format_number(day.sky_height_px)) +
         line("log_extinction_sigma", day.log_extinction_sigma) +
         line("independent_targets", day.independent_targets) + fmt::format("colour = {}\n", day.colour);
}

}  // namespace

Site read_site_tables(ConfigTable& tables, const std::filesystem::path& folder) {
  Site site;
  ConfigTable place = tables.required_table("site");
  site.name = place.required_text("name");
  site.latitude_deg = place.number("latitude_deg", {-90, 90});
  site.longitude_deg = place.number("longitude_deg", {-180, 180});
  site.elevation_m = place.number("elevation_m", {-500, 9000});
  site.camera = read_camera(tables.required_table("camera"), folder);
  std::set<std::string> light_ids, target_ids;
  for (ConfigTable& table : tables.tables("light")) {
    site.lights.push_back(read_light(table, site.camera, light_ids));
    if (site.lights.size() == kMaxLights + 1)
      table.problem("id", fmt::format("is one too many; expected at most {} lights", kMaxLights));
  }
  for (ConfigTable& table : tables.tables("target"))
    site.targets.push_back(read_target(table, site.camera, target_ids));
  if (const auto night = tables.table("night")) site.night = read_patches(*night);
  if (const auto patches = tables.table("day_patches")) site.day_patches = read_patches(*patches);
  if (const auto day = tables.table("day")) site.day = read_day(*day, site.camera);
  return site;
}

Site parse_site(std::string_view text, const std::string& name, const std::filesystem::path& folder) {
  ConfigFile file(text, name);
  ConfigTable root = file.root();
  Site site = read_site_tables(root, folder);
  file.finish();
  return site;
}

Site read_site_file(const std::filesystem::path& path) {
  return parse_site(read_text_file(path), path.string(), path.parent_path());
}

std::vector<double> read_response_curve(const std::filesystem::path& path, int bit_depth) {
  Problems problems(path.string());
  const CsvTable table = parse_csv(read_text_file(path), problems);
  const auto places = find_columns(table, {"dn", "relative_radiance"}, problems);
  problems.throw_data_error();
  const std::size_t levels = std::size_t{1} << bit_depth;
  if (table.rows.size() != levels)
    problems.add(1, 1, "dn",
                 fmt::format("expected {} rows, 0 to {}, got {}", levels, levels - 1, table.rows.size()));
  std::vector<double> curve;
  for (const auto& row : table.rows) {
    const CsvCell& dn = row[*places[0]];
    const CsvCell& radiance = row[*places[1]];
    if (dn.text != std::to_string(curve.size()))
      problems.add(dn.line, dn.column, "dn", fmt::format("expected {}, got \"{}\"", curve.size(), dn.text));
    const auto value = parse_number(radiance.text);
    if (!value || *value < 0 || (!curve.empty() && *value < curve.back()))
      problems.add(radiance.line, radiance.column, "relative_radiance",
                   fmt::format("expected a number of at least 0 that is not below the row before, got \"{}\"",
                               radiance.text));
    curve.push_back(value.value_or(curve.empty() ? 0 : curve.back()));
  }
  if (!curve.empty() && curve.back() <= curve.front())
    problems.add(1, 1, "relative_radiance", "expected a curve that rises, it is flat");
  problems.throw_data_error();
  return curve;
}

std::string format_response_curve(const std::vector<double>& curve) {
  std::string text = "dn,relative_radiance\n";
  for (std::size_t dn = 0; dn < curve.size(); ++dn) text += fmt::format("{},{}\n", dn, curve[dn]);
  return text;
}

std::string format_light(const Light& light) {
  return "[[light]]\n" + fmt::format("id = {}\n", format_text(light.id)) + line("x_px", light.x_px) +
         line("y_px", light.y_px) + line("distance_m", light.distance_m) +
         line("distance_sigma_m", light.distance_sigma_m);
}

std::string format_target(const Target& target) {
  return "[[target]]\n" + fmt::format("id = {}\n", format_text(target.id)) +
         fmt::format("box_px = [{}, {}, {}, {}]\n", format_number(target.x_px), format_number(target.y_px),
                     format_number(target.width_px), format_number(target.height_px)) +
         line("distance_m", target.distance_m) + line("distance_sigma_m", target.distance_sigma_m) +
         line("brightness_ratio", target.brightness_ratio) +
         line("brightness_ratio_sigma", target.brightness_ratio_sigma) +
         (target.contrast ? format_contrast(*target.contrast) : "");
}

std::string format_site(const Site& site, const std::string& response_file) {
  std::string text = fmt::format("[site]\nname = {}\n", format_text(site.name));
  text += line("latitude_deg", site.latitude_deg) + line("longitude_deg", site.longitude_deg) +
          line("elevation_m", site.elevation_m);
  text += "\n" + format_camera(site.camera, response_file);
  if (site.night) text += "\n" + format_patches("night", *site.night);
  if (site.day_patches) text += "\n" + format_patches("day_patches", *site.day_patches);
  if (site.day) text += "\n" + format_day(*site.day);
  for (const Light& light : site.lights) text += "\n" + format_light(light);
  for (const Target& target : site.targets) text += "\n" + format_target(target);
  return text;
}

void write_site_file(const std::filesystem::path& path, const Site& site) {
  const std::string response_file = path.stem().string() + "_response.csv";
  if (site.camera.response.kind == Response::Kind::curve)
    write_file_atomically(path.parent_path() / response_file,
                          format_response_curve(site.camera.response.curve));
  write_file_atomically(path, format_site(site, response_file));
}

}  // namespace lampglow::daemon
