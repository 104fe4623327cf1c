#include "daemon/simulation/daylight.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "daemon/simulation/random.h"
#include "estimator/inference/sun.h"

namespace lampglow::simulation {

namespace {

enum Stream : std::uint64_t {
  kTargets = 200,
  kLight,
  kInhomogeneity,
  kBrightness,
  kLampSwitch,
  kTexture,
  kClouds
};

constexpr double kEyeHeight_m = 8;
constexpr double kGroundReflectance = 0.12;
constexpr double kLampsOffAbove_deg = -2;
constexpr double kBrightSky_lux = 5e4;           // at this illuminance ...
constexpr double kBrightSkyElectronsPerS = 4e7;  // ... the horizon sky gives this in a pixel

double radians(double degrees) {
  return degrees * std::numbers::pi / 180;
}

// Illuminance on the ground against the sun's altitude, from full day to night (Seidelmann, Explanatory
// Supplement to the Astronomical Almanac, 1992, fig. 9.311-1, to about 20 %).
double illuminance_lux(double altitude_deg) {
  constexpr double kAltitude_deg[] = {-18, -12, -6, 0, 5, 10, 30, 60, 90};
  constexpr double kLux[] = {6e-4, 8e-3, 3.4, 400, 4000, 1e4, 5e4, 1e5, 1.2e5};
  const double altitude = std::clamp(altitude_deg, -18.0, 89.9);
  size_t i = 0;
  while (kAltitude_deg[i + 1] <= altitude) ++i;
  const double share = (altitude - kAltitude_deg[i]) / (kAltitude_deg[i + 1] - kAltitude_deg[i]);
  return std::exp(std::log(kLux[i]) + share * std::log(kLux[i + 1] / kLux[i]));
}

// Near things are taller in the picture; each stands on the ground and rises over the horizon.
SkylineTarget make_target(double distance_m, int slot, int slots, Random& random) {
  SkylineTarget target;
  const double height_m = 11 * std::pow(distance_m / 150, 0.55) * random.uniform(0.9, 1.2);
  const double over_horizon_px = (height_m - kEyeHeight_m * 0.5) / distance_m * kFocalLengthPx;
  const double base_px = kEyeHeight_m * 0.5 / distance_m * kFocalLengthPx;
  const int slot_px = (kWidthPx - 40) / slots;
  target.width_px = std::min(slot_px - 24, static_cast<int>(random.uniform(70, 120)));
  target.x_px = 20 + slot * slot_px + random.below(std::max(1, slot_px - target.width_px));
  target.height_px = std::max(10, static_cast<int>(over_horizon_px + base_px));
  target.y_px = static_cast<int>(kHorizonRow + base_px) - target.height_px;
  target.distance_m = distance_m;
  target.reflectance = random.uniform(0.03, 0.1);
  return target;
}

void place_targets(Night& night) {
  Random random(night.options.seed, {kTargets});
  const std::vector<double>& distances = night.options.targets_m;
  std::vector<int> slots(distances.size());
  for (size_t i = 0; i < slots.size(); ++i) slots[i] = static_cast<int>(i);
  for (size_t i = slots.size(); i > 1; --i) {
    std::swap(slots[i - 1], slots[static_cast<size_t>(random.below(static_cast<int>(i)))]);
  }
  for (size_t i = 0; i < distances.size(); ++i) {
    night.targets.push_back(make_target(distances[i], slots[i], static_cast<int>(slots.size()), random));
    night.targets.back().id = "T" + std::to_string(i + 1);
  }
}

// A surface that faces the camera: half of its light is the sky's, the other half the sun's where that shines
// on it through the air.
double lit_by_sun(const SunAngles& sun, double extinction_per_m) {
  const double facing = std::cos(radians(sun.azimuth_deg - kCameraAzimuth_deg - 180)) *
                        std::cos(radians(std::max(0.0, sun.altitude_deg)));
  const double clear = std::exp(-extinction_per_m * 400);
  return 1 + (sun.altitude_deg > 0 ? 0.6 * clear * std::max(0.0, facing) : 0);
}

void set_light(Night& night, size_t index, double brightness_change) {
  Frame& frame = night.frames[index];
  const inference::SunPosition sun = inference::sun_position(frame.time_utc, kLatitude_deg, kLongitude_deg);
  frame.day.sun = {sun.altitude_deg, sun.azimuth_deg};
  const double lux = illuminance_lux(sun.altitude_deg);
  frame.day.horizon_electrons_per_s =
      kBrightSkyElectronsPerS * lux / kBrightSky_lux * std::exp(0.25 * brightness_change);
}

// Air is not the same everywhere: each path has its own extinction, the horizon is not quite the paths'
// airlight, and surfaces get wet and dry.
void disturb_light(Night& night, size_t index) {
  Daylight& day = night.frames[index].day;
  const double share = night.frames[index].role == FrameRole::clear_reference ? 0.2 : 1;
  Random air(night.options.seed, {kInhomogeneity, index});
  Random surface(night.options.seed, {kBrightness, index});
  for (size_t t = 0; t <= night.targets.size(); ++t) {
    day.path_extinction.push_back(std::exp(0.05 * air.normal()));
    day.target_brightness.push_back(std::exp(share * 0.1 * surface.normal()) *
                                    lit_by_sun(day.sun, night.frames[index].extinction_per_m));
  }
  day.airlight = std::exp(share * 0.01 * air.normal());
}

void switch_lamps_by_sun(Night& night) {
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    Random random(night.options.seed, {kLampSwitch, l});
    const double off_above_deg = kLampsOffAbove_deg + random.uniform(-1, 1);
    for (Frame& frame : night.frames) {
      if (frame.day.sun.altitude_deg > off_above_deg) frame.lamp_strength[l] = 0;
    }
  }
}

// Leaves, windows, rocks: fixed patches of some pixels, 1 in the mean.
double texture(std::uint64_t seed, int column, int row) {
  Random patch(seed, {kTexture, static_cast<std::uint64_t>(column / 3 + 1000),
                      static_cast<std::uint64_t>(row / 2 + 1000)});
  return std::exp(0.25 * patch.normal());
}

// What stands in this pixel: a target, or the ground (index targets.size()), or nothing.
struct Thing {
  bool sky = true;
  size_t index = 0;
  double distance_m = 0;
  double reflectance = 0;
};

Thing thing_at(const Night& night, double x_px, double y_px) {
  const SkylineTarget* nearest = nullptr;
  for (const SkylineTarget& target : night.targets) {
    const bool inside = x_px >= target.x_px && x_px < target.x_px + target.width_px && y_px >= target.y_px &&
                        y_px < target.y_px + target.height_px;
    if (inside && (!nearest || target.distance_m < nearest->distance_m)) nearest = &target;
  }
  if (nearest) {
    return {false, static_cast<size_t>(nearest - night.targets.data()), nearest->distance_m,
            nearest->reflectance};
  }
  if (y_px <= kHorizonRow) return {};
  return {false, night.targets.size(), kEyeHeight_m * kFocalLengthPx / (y_px - kHorizonRow),
          kGroundReflectance};
}

// Of a thing in this column, over the horizon sky's.
double surface_brightness(const Night& night, const Daylight& day, const Thing& thing, double x_px) {
  if (!day.snow.empty()) return day.snow[thing.index];
  double brightness = thing.reflectance * day.target_brightness[thing.index];
  if (thing.index < day.sunlight.size()) {
    const SkylineTarget& target = night.targets[thing.index];
    const Sunlight& sun = day.sunlight[thing.index];
    if (x_px < target.x_px + sun.edge * target.width_px) brightness *= sun.brightness;
  }
  return brightness;
}

// Horizon sky darkens upwards in clear air and is brighter towards the sun; in fog it is even. Clouds drift.
double sky_shape(const Night& night, const Frame& frame, double x_px, double y_px) {
  const double elevation_deg = std::max(0.0, (kHorizonRow - y_px) / kFocalLengthPx / radians(1));
  const double azimuth_deg = kCameraAzimuth_deg + (x_px - kWidthPx / 2.0) / kFocalLengthPx / radians(1);
  const double clear = std::exp(-frame.extinction_per_m * 2000);
  const double sunward = 0.5 * (1 + std::cos(radians(azimuth_deg - frame.day.sun.azimuth_deg)));
  Random drift(night.options.seed,
               {kClouds, static_cast<std::uint64_t>(frame.time_utc.time_since_epoch().count())});
  const double phase = drift.uniform(0, 6.28);
  const double cloud =
      0.06 * std::sin(x_px / 90 + phase) * std::sin(y_px / 45 + 2 * phase) * std::min(1.0, elevation_deg / 4);
  return (1 - 0.35 * clear * std::min(1.0, elevation_deg / 18)) * (1 + 0.3 * clear * (sunward - 0.3)) *
         (1 + clear * cloud);
}

}  // namespace

void add_daylight(Night& night) {
  place_targets(night);
  Random light(night.options.seed, {kLight});
  double change = 0;
  for (size_t i = 0; i < night.frames.size(); ++i) {
    change = 0.7 * change + 0.71 * light.normal();
    set_light(night, i, change);
    disturb_light(night, i);
  }
  switch_lamps_by_sun(night);
}

void add_skyline(Image<double>& canvas, const Night& night, const Frame& frame, int margin_px) {
  const Daylight& day = frame.day;
  const double airlight = frame.gain * (day.horizon_electrons_per_s + frame.sky_electrons_per_s);
  for (int row = 0; row < canvas.height_px; ++row) {
    for (int column = 0; column < canvas.width_px; ++column) {
      // Where the resting camera sees what this pixel of the shaken one does.
      const double u = column - margin_px + 0.5 - frame.shift_x_px - kWidthPx / 2.0;
      const double v = row - margin_px + 0.5 - frame.shift_y_px - kHeightPx / 2.0;
      const double x_px = kWidthPx / 2.0 + u + frame.rotation_rad * v;
      const double y_px = kHeightPx / 2.0 + v - frame.rotation_rad * u;
      const double behind = airlight * sky_shape(night, frame, x_px, std::min(y_px, kHorizonRow));
      const Thing thing = thing_at(night, x_px, y_px);
      if (thing.sky) {
        canvas.at(column, row) += behind;
        continue;
      }
      const double seen =
          std::exp(-frame.extinction_per_m * day.path_extinction[thing.index] * thing.distance_m);
      const double surface =
          airlight * surface_brightness(night, day, thing, x_px) *
          texture(night.options.seed, static_cast<int>(std::floor(x_px)), static_cast<int>(std::floor(y_px)));
      canvas.at(column, row) += surface * seen + behind * day.airlight * (1 - seen);
    }
  }
}

}  // namespace lampglow::simulation
