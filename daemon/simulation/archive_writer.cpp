#include "daemon/simulation/archive_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>

#include "daemon/errors.h"
#include "daemon/pictures/jpeg.h"
#include "daemon/pictures/png.h"
#include "daemon/simulation/random.h"

namespace lampglow::simulation {

namespace {

void write_text(const std::filesystem::path& file, std::string_view text) {
  std::ofstream stream(file, std::ios::binary | std::ios::trunc);
  stream << text;
  stream.close();
  if (!stream) throw daemon::IoError("cannot write " + file.string());
}

std::string number(double value) {
  return fmt::format("{:.6g}", value);
}

std::string number(const std::optional<double>& value) {
  return value ? number(*value) : "";
}

std::string camera_table(const Sensor& sensor) {
  std::string text = fmt::format(
      "[camera]\nwidth_px = {}\nheight_px = {}\nfocal_length_px = {:.1f}\nprincipal_point_px = [{:.1f}, "
      "{:.1f}]\n"
      "bit_depth = {}\nblack_level_dn = {:.1f}\nsaturation_dn = {:.1f}\nresponse = \"{}\"\n",
      kWidthPx, kHeightPx, kFocalLengthPx, kWidthPx / 2.0, kHeightPx / 2.0, sensor.bit_depth,
      sensor.black_level_dn, sensor.saturation_dn, sensor.srgb ? "srgb" : "linear");
  if (!sensor.srgb) {
    text += fmt::format("read_noise_dn = {}\ngain_dn_per_electron = {}\n", sensor.read_noise_dn,
                        sensor.gain_dn_per_electron);
  }
  return text;
}

// The window's covered part, is there snow, and what part of each target the sun alone shines on (empty: no
// shadow's edge is near).
std::string event_truth(const Night& night, const Frame& frame) {
  std::string text = fmt::format(",{:.3f},{}", covered_part(frame.drops), frame.day.snow.empty() ? 0 : 1);
  for (size_t t = 0; t < night.targets.size(); ++t) {
    text += ",";
    if (t < frame.day.sunlight.size())
      text += fmt::format("{:.2f}", std::clamp(frame.day.sunlight[t].edge, 0.0, 1.0));
  }
  return text;
}

}  // namespace

void write_picture(const std::filesystem::path& file, const Image<std::uint16_t>& picture) {
  const auto& pixels = picture.pixels;
  daemon::Bytes bytes;
  if (file.extension() == ".jpg") {
    std::vector<std::uint8_t> colours;
    colours.reserve(3 * pixels.size());
    for (const std::uint16_t dn : pixels)
      colours.insert(colours.end(), 3, static_cast<std::uint8_t>(std::min<int>(dn, 255)));
    bytes = daemon::encode_jpeg(
        {{picture.width_px, picture.height_px, 3, 8}, std::span<const std::uint8_t>(colours)}, 92);
  } else {
    bytes = daemon::encode_png(
        {{picture.width_px, picture.height_px, 1, 16}, std::span<const std::uint16_t>(pixels)});
  }
  write_text(file, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

// A catalogue is made by hand or by `survey`: its positions are off by up to half a pixel.
void write_site(const std::filesystem::path& file, const Night& night, const Sensor& sensor) {
  std::string text = fmt::format(
      "# A simulated night: lampglow simulate --seed {}\n[site]\nname = \"simulated night, seed {}\"\n"
      "latitude_deg = {}\nlongitude_deg = {}\nelevation_m = 10.0\n\n{}",
      night.options.seed, night.options.seed, kLatitude_deg, kLongitude_deg, camera_table(sensor));
  Random random(night.options.seed, {100});
  for (const Lamp& lamp : night.lamps) {
    const double x_px = lamp.x_px + random.uniform(-0.5, 0.5);
    const double y_px = lamp.y_px + random.uniform(-0.5, 0.5);
    if (!lamp.in_catalogue) continue;
    text += fmt::format("\n[[light]]\nid = \"{}\"\nx_px = {:.1f}\ny_px = {:.1f}\ndistance_m = {:.1f}\n",
                        lamp.id, x_px, y_px, lamp.distance_m);
  }
  for (const SkylineTarget& target : night.targets) {
    text +=
        fmt::format("\n[[target]]\nid = \"{}\"\nbox_px = [{}, {}, {}, {}]\ndistance_m = {:.1f}\n", target.id,
                    target.x_px, target.y_px, target.width_px, target.height_px, target.distance_m);
  }
  write_text(file, text);
}

void write_frames(const std::filesystem::path& file, const Night& night,
                  const std::vector<std::vector<PictureRecord>>& records) {
  std::string text = "time_utc,file,exposure_s,gain_db,role,reference_mor_m\n";
  for (size_t i = 0; i < night.frames.size(); ++i) {
    const Frame& frame = night.frames[i];
    const bool reference = frame.role == FrameRole::clear_reference;
    for (const PictureRecord& record : records[i]) {
      text += fmt::format("{},{},{},{},{},{}\n", format_time_utc(frame.time_utc), record.file,
                          number(record.exposure_s), number(record.gain_db),
                          reference ? "clear_reference" : "observation",
                          reference ? fmt::format("{:.0f}", frame.mor_m()) : "");
    }
  }
  write_text(file, text);
}

void write_truth(const std::filesystem::path& file, const Night& night,
                 const std::vector<std::optional<double>>& bounds) {
  std::string text = "time_utc,mor_m,q,weather,crb_ln_extinction\n";
  for (size_t i = 0; i < night.frames.size(); ++i) {
    const Frame& frame = night.frames[i];
    if (frame.role != FrameRole::observation) continue;
    text += fmt::format("{},{:.1f},{:.4f},{},{}\n", format_time_utc(frame.time_utc), frame.mor_m(), frame.q,
                        to_string(frame.weather), number(bounds[i]));
  }
  write_text(file, text);
}

void write_full_truth(const std::filesystem::path& file, const Night& night,
                      const std::vector<std::optional<double>>& bounds,
                      const std::vector<double>& longest_exposure_s) {
  std::string text =
      "time_utc,role,mor_m,extinction_per_m,q,weather,gain,longest_exposure_s,shift_x_px,shift_y_px,rotation_"
      "rad,"
      "sky_electrons_per_s,sun_altitude_deg,cars,crb_ln_extinction";
  for (const Lamp& lamp : night.lamps) text += ",strength_" + lamp.id;
  text += ",window_covered,snow";
  for (const SkylineTarget& target : night.targets) text += ",sunlit_" + target.id;
  text += "\n";
  for (size_t i = 0; i < night.frames.size(); ++i) {
    const Frame& frame = night.frames[i];
    text += fmt::format("{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}", format_time_utc(frame.time_utc),
                        frame.role == FrameRole::observation ? "observation" : "clear_reference",
                        frame.mor_m(), frame.extinction_per_m, frame.q, to_string(frame.weather), frame.gain,
                        longest_exposure_s[i], frame.shift_x_px, frame.shift_y_px, frame.rotation_rad,
                        frame.sky_electrons_per_s, frame.day.sun.altitude_deg, frame.cars.size(),
                        number(bounds[i]));
    for (const double strength : frame.lamp_strength) text += fmt::format(",{}", strength);
    text += event_truth(night, frame) + "\n";
  }
  text += "\n";
  text.pop_back();
  write_text(file, text);
  std::string lamps = "id,x_px,y_px,distance_m,intensity,height_m,in_catalogue\n";
  for (const Lamp& lamp : night.lamps) {
    lamps += fmt::format("{},{},{},{},{},{},{}\n", lamp.id, lamp.x_px, lamp.y_px, lamp.distance_m,
                         lamp.intensity, lamp.height_m, lamp.in_catalogue ? 1 : 0);
  }
  write_text(std::filesystem::path(file).replace_filename("truth_lamps.csv"), lamps);
}

}  // namespace lampglow::simulation
