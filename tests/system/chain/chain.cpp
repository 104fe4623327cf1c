#include "tests/system/chain/chain.h"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <opencv2/imgcodecs.hpp>

#include "storage/reader.h"
#include "tests/support/run_program.h"

namespace lampglow::testing {
namespace {

std::string without_lines(const std::string& text, const std::vector<std::string>& beginnings) {
  std::istringstream lines(text);
  std::string kept;
  for (std::string line; std::getline(lines, line);) {
    const auto begins = [&](const std::string& beginning) { return line.starts_with(beginning); };
    if (std::ranges::none_of(beginnings, begins)) kept += line + "\n";
  }
  return kept;
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
  return text;
}

void copy_as_png(const fs::path& jpeg_archive, const fs::path& png_archive) {
  fs::create_directories(png_archive / "images");
  for (const auto& entry : fs::directory_iterator(jpeg_archive / "images")) {
    const cv::Mat grey = cv::imread(entry.path().string(), cv::IMREAD_GRAYSCALE);
    const fs::path png = png_archive / "images" / entry.path().filename().replace_extension(".png");
    ASSERT_TRUE(cv::imwrite(png.string(), grey, {cv::IMWRITE_PNG_COMPRESSION, 1})) << png;
  }
  write_file(png_archive / "frames.csv",
             replaced(test::read_all(jpeg_archive / "frames.csv"), ".jpg", ".png"));
  fs::copy_file(jpeg_archive / "site.toml", png_archive / "site.toml");
}

}  // namespace

void make_night(const fs::path& folder, int frames) {
  const fs::path jpeg = folder / "jpeg";
  const auto run =
      test::run_program({"simulate", jpeg.string(), "--style", "webcam", "--seed", "1", "--frames",
                         std::to_string(frames), "--photons", "50000", "--without", "all"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  write_file(jpeg / "site.toml",
             without_lines(test::read_all(jpeg / "site.toml"), {"latitude_deg", "longitude_deg"}));
  copy_as_png(jpeg, folder / "png");
}

Night replay_night(const fs::path& archive, const fs::path& database) {
  Night night{archive, {}, {}};
  std::istringstream rows(test::read_all(archive / "frames.csv"));
  for (std::string row; std::getline(rows, row);) {
    if (row.find(",observation,") == std::string::npos) continue;
    const std::size_t begin = row.find(',') + 1;
    night.pictures.push_back(archive / row.substr(begin, row.find(',', begin) - begin));
  }
  const auto run = test::run_program({"replay", archive.string(), "--db", database.string()});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  night.truth = stored_in(database);
  EXPECT_GE(night.truth.size(), night.pictures.size());
  night.truth.erase(night.truth.begin(),
                    night.truth.end() - static_cast<std::ptrdiff_t>(night.pictures.size()));
  return night;
}

std::vector<storage::ObservationRow> stored_in(const fs::path& database) {
  try {
    storage::Reader reader(database);
    const auto cameras = reader.cameras();
    if (cameras.empty()) return {};
    return reader.observations({cameras.front().number,
                                TimePoint{},
                                parse_time_utc("9999-12-31T00:00:00Z").value(),
                                0,
                                {},
                                100'000});
  } catch (const storage::StorageError&) {
    return {};
  }
}

std::string difference(const Observation& live, const Observation& archived) {
  const auto flags = [](const Observation& observation) {
    QualityFlags live_only;
    live_only.set(Quality::camera_not_locked);
    live_only.set(Quality::clock_unsynchronised);
    return observation.quality.bits() & ~live_only.bits();
  };
  std::string text;
  const auto compare = [&](const char* name, const auto& a, const auto& b) {
    if (!(a == b)) text += std::string(text.empty() ? "" : ", ") + name;
  };
  compare("extinction", live.extinction_per_m, archived.extinction_per_m);
  compare("extinction_low", live.extinction_low_per_m, archived.extinction_low_per_m);
  compare("extinction_high", live.extinction_high_per_m, archived.extinction_high_per_m);
  compare("limit", live.limit, archived.limit);
  compare("q", live.q, archived.q);
  compare("q_low", live.q_low, archived.q_low);
  compare("q_high", live.q_high, archived.q_high);
  compare("weather", live.weather, archived.weather);
  compare("weather_probability", live.weather_probability, archived.weather_probability);
  compare("method", live.method, archived.method);
  compare("lights_used", live.lights_used, archived.lights_used);
  compare("quality", flags(live), flags(archived));
  return text;
}

double log_ratio(const Observation& live, const Observation& archived) {
  return std::abs(std::log(live.extinction_per_m.value() / archived.extinction_per_m.value()));
}

ChainStation::ChainStation(const fs::path& folder, const fs::path& reference_archive,
                           const std::string& source, int interval_s)
    : folder_(folder), reference_archive_(reference_archive), source_(source) {
  fs::create_directories(folder_);
  configure(interval_s);
  serving_ = std::make_unique<Serving>(folder_ / "station.toml", folder_ / "log");
}

void ChainStation::configure(int interval_s) const {
  write_file(folder_ / "station.toml",
             fmt::format("name = \"chain\"\nsite_file = \"{0}/site.toml\"\nreference_archive = \"{0}\"\n\n"
                         "[source]\n{1}\n\n[schedule]\ninterval_s = {3}\nwhen = \"both\"\n\n"
                         "[station]\ndata_directory = \"data\"\n\n[http]\nport = {2}\n",
                         reference_archive_.string(), source_, port_, interval_s));
}

void ChainStation::reload_with(int interval_s) const {
  configure(interval_s);
  serving_->signal(SIGHUP);
  const auto reloaded = [&] { return log().find("info configuration reloaded file") != std::string::npos; };
  EXPECT_TRUE(eventually(std::chrono::seconds(20), reloaded)) << log();
}

bool ChainStation::stores(const Observation& archived, std::chrono::seconds limit) const {
  std::string why;
  const bool good = eventually(limit, [&] {
    why.clear();
    for (const auto& row : stored()) {
      const std::string differs = difference(row.observation, archived);
      if (differs.empty()) return true;
      why += fmt::format("{} {:.17g} per m, {}: {} differ\n", format_time_utc(row.observation.time_utc),
                         row.observation.extinction_per_m.value_or(0), row.reason, differs);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(100));  // a question to the database, not a race
    return false;
  });
  EXPECT_TRUE(good) << "not stored: " << archived.extinction_per_m.value_or(0) << " per m; instead\n"
                    << why << log();
  return good;
}

}  // namespace lampglow::testing
