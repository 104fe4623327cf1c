// Writes a simulated archive: site.toml, frames.csv, truth.csv, truth_full.csv and the pictures.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "daemon/simulation/night.h"
#include "daemon/simulation/sensor.h"
#include "estimator/photometry/image.h"

namespace lampglow::simulation {

// One picture of the archive, as its row in frames.csv says.
struct PictureRecord {
  std::string file;                  // "images/0003_1.png"
  std::optional<double> exposure_s;  // empty: automatic
  std::optional<double> gain_db;
};

// 16-bit PNG, or 8-bit JPEG (three equal channels) by the file's name. Throws IoError.
void write_picture(const std::filesystem::path& file, const Image<std::uint16_t>& picture);

void write_site(const std::filesystem::path& file, const Night& night, const Sensor& sensor);

// records[i] are the pictures of night.frames[i].
void write_frames(const std::filesystem::path& file, const Night& night,
                  const std::vector<std::vector<PictureRecord>>& records);

// The observations' visibility, q, weather and, if known, the bound of ln σ (Cramér-Rao).
void write_truth(const std::filesystem::path& file, const Night& night,
                 const std::vector<std::optional<double>>& bounds);

// Everything that is true of every frame, for tests and benches; replay does not read it.
void write_full_truth(const std::filesystem::path& file, const Night& night,
                      const std::vector<std::optional<double>>& bounds,
                      const std::vector<double>& longest_exposure_s);

}  // namespace lampglow::simulation
