#include "daemon/simulation/simulate.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <mutex>
#include <numeric>

#include "daemon/simulation/archive_writer.h"
#include "daemon/simulation/bound.h"
#include "daemon/simulation/parallel.h"
#include "daemon/simulation/random.h"
#include "daemon/simulation/render.h"
#include "daemon/simulation/sensor.h"

namespace lampglow::simulation {

namespace {

constexpr std::array<double, 3> kNightBracket_s = {0.008, 0.125, 2.0};
enum Stream : std::uint64_t { kSensorNoise = 50, kHotPixels, kAutomaticExposure };

// Each q once, with the largest optical thickness that a lamp or car is seen through.
std::vector<HaloRun> halo_runs(const Night& night) {
  double farthest_m = 400;
  for (const Lamp& lamp : night.lamps) farthest_m = std::max(farthest_m, lamp.distance_m);
  std::map<double, double> thickness_of_q;
  for (const Frame& frame : night.frames) {
    double& thickness = thickness_of_q[frame.q];
    thickness = std::min(HaloLibrary::kThickest, std::max(thickness, frame.extinction_per_m * farthest_m));
  }
  std::vector<HaloRun> runs;
  runs.reserve(thickness_of_q.size());
  for (const auto& [q, thickness] : thickness_of_q) runs.push_back({q, thickness});
  return runs;
}

// A webcam's exposure in seconds. By night it follows the picture's mean half-way round one second, within
// limits; by day it holds the mean at a fifth of the range. It never says what it did.
double automatic_exposure_s(const Image<double>& electrons_per_s, const NightOptions& options, size_t frame) {
  constexpr double kMeteredElectronsPerS = 150;
  constexpr double kDayElectrons = 2000;
  Random random(options.seed, {kAutomaticExposure, frame});
  const double mean = std::accumulate(electrons_per_s.pixels.begin(), electrons_per_s.pixels.end(), 0.0) /
                      static_cast<double>(electrons_per_s.pixels.size());
  const double by_night = std::clamp(std::pow(kMeteredElectronsPerS / mean, 0.5), 0.25, 4.0);
  return std::min(by_night, kDayElectrons / mean) * std::exp(0.08 * random.normal());
}

// The station's bracket: by night three fixed exposures; by day the middle one puts the horizon sky at half
// the range, the others are a quarter and four times it.
std::array<double, 3> bracket_exposures_s(const Frame& frame) {
  const double middle_s = 7500 / (frame.day.horizon_electrons_per_s + 1);
  if (4 * middle_s > kNightBracket_s[2]) return kNightBracket_s;
  return {middle_s / 4, middle_s, middle_s * 4};
}

class ArchiveMaker {
 public:
  ArchiveMaker(const Night& night, const HaloLibrary& halos, std::filesystem::path directory)
      : night_(night),
        halos_(halos),
        renderer_(night, halos),
        directory_(std::move(directory)),
        sensor_(night.options.style == Style::bracket ? bracket_sensor() : webcam_sensor()),
        records_(night.frames.size()),
        exposures_s_(night.frames.size(), 1),
        bounds_(night.frames.size()) {
    Random random(night.options.seed, {kHotPixels});
    if (night.options.nuisances.hot_pixels) hot_pixels_ = draw_hot_pixels(kWidthPx, kHeightPx, random);
  }

  void make_frame(size_t index) {
    const Frame& frame = night_.frames[index];
    take_pictures(index, seen_through(renderer_.still_scene(frame), frame.drops));
    // The bound knows even lamps, not targets.
    if (night_.options.hours != Hours::night || night_.options.luminaire != Luminaire::even) return;
    std::vector<double> exposures_s = {exposures_s_[index]};
    if (night_.options.style == Style::bracket)
      exposures_s.assign(kNightBracket_s.begin(), kNightBracket_s.end());
    bounds_[index] = bound_of_ln_extinction(night_, frame, halos_, sensor_, exposures_s);
  }

  // Of the first `count` frames.
  void write_tables(size_t count) const {
    Night taken = night_;
    taken.frames.resize(count);
    write_site(directory_ / "site.toml", taken, sensor_);
    write_frames(directory_ / "frames.csv", taken, records_);
    write_truth(directory_ / "truth.csv", taken, bounds_);
    write_full_truth(directory_ / "truth_full.csv", taken, bounds_, exposures_s_);
  }

 private:
  void take_pictures(size_t index, const Image<double>& still) {
    if (night_.options.style == Style::webcam) {
      exposures_s_[index] = automatic_exposure_s(still, night_.options, index);
      expose_to_file(index, 0, still, 0, exposures_s_[index]);
      return;
    }
    double start_s = 0;
    int number = 0;
    for (const double exposure_s : bracket_exposures_s(night_.frames[index])) {
      expose_to_file(index, number++, still, start_s, exposure_s);
      exposures_s_[index] = exposure_s;
      start_s += exposure_s + 0.1;
    }
  }

  void expose_to_file(size_t index, int number, const Image<double>& still, double start_s,
                      double exposure_s) {
    const bool webcam = night_.options.style == Style::webcam;
    PictureRecord record;
    record.file =
        webcam ? fmt::format("images/{:04}.jpg", index) : fmt::format("images/{:04}_{}.png", index, number);
    if (!webcam) record.exposure_s = exposure_s;
    if (!webcam) record.gain_db = 0;
    Image<double> scene = still;
    renderer_.add_cars(scene, night_.frames[index], start_s, start_s + exposure_s);
    Random random(night_.options.seed, {kSensorNoise, index, static_cast<std::uint64_t>(number)});
    write_picture(directory_ / record.file, expose(scene, exposure_s, sensor_, hot_pixels_, random));
    records_[index].push_back(record);
  }

  const Night& night_;
  const HaloLibrary& halos_;
  Renderer renderer_;
  std::filesystem::path directory_;
  Sensor sensor_;
  std::vector<HotPixel> hot_pixels_;
  std::vector<std::vector<PictureRecord>> records_;
  std::vector<double> exposures_s_;  // the longest of each frame
  std::vector<std::optional<double>> bounds_;
};

}  // namespace

int simulate_night(const NightOptions& options, const SimulationRun& run, const Progress& progress,
                   const std::stop_token& stop) {
  std::filesystem::create_directories(run.directory / "images");
  const Night night = plan_night(options);
  // With all luminaires cut-off only cars have even halos.
  const std::uint64_t photons = options.luminaire == Luminaire::cutoff ? run.photons / 10 : run.photons;
  const HaloLibrary halos(
      halo_runs(night), photons, options.seed, run.workers,
      [&](int done, int of) { progress("counting photons", done, of); }, stop);
  if (stop.stop_requested()) {
    std::filesystem::remove(run.directory / "images");
    return 0;
  }
  ArchiveMaker maker(night, halos, run.directory);
  int done = 0;
  std::mutex mutex;
  const int count = static_cast<int>(night.frames.size());
  const int taken = for_each_index(
      count, run.workers,
      [&](int i) {
        maker.make_frame(static_cast<size_t>(i));
        const std::lock_guard lock(mutex);
        progress("taking pictures", ++done, count);
      },
      stop);
  maker.write_tables(static_cast<size_t>(taken));
  return std::max(0, taken - night.references);
}

}  // namespace lampglow::simulation
