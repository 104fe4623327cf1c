#include "daemon/simulation/night.h"

#include <algorithm>
#include <cmath>

#include "daemon/simulation/daylight.h"
#include "daemon/simulation/events.h"
#include "daemon/simulation/random.h"
#include "daemon/simulation/weather.h"

namespace lampglow::simulation {

namespace {

using namespace std::chrono;

// Streams of random numbers, one for each thing that is drawn, so that switching one nuisance off leaves all
// the others as they were.
enum Stream : std::uint64_t {
  kLamps = 1,
  kWeather,
  kGain,
  kDrift,
  kDimming,
  kOutages,
  kShake,
  kCars,
  kStray,
  kSky
};

// A winter night, or a day near the equinox.
struct Schedule {
  std::vector<TimePoint> references;
  TimePoint first{};
  minutes length{};
};
constexpr double kEdgePx = 40;
constexpr int kStrayLights = 3;
constexpr double kClearSkyElectronsPerS = 40;

std::vector<double> lamp_distances(const NightOptions& options) {
  if (!options.distances_m.empty()) return options.distances_m;
  std::vector<double> distances;
  for (int i = 0; i < options.lamps; ++i) {
    const double fraction = options.lamps == 1 ? 0.5 : static_cast<double>(i) / (options.lamps - 1);
    distances.push_back(options.nearest_m * std::pow(options.farthest_m / options.nearest_m, fraction));
  }
  return distances;
}

double nearest_lamp_px(const std::vector<Lamp>& lamps, double x_px, double y_px) {
  double nearest = 1e9;
  for (const Lamp& lamp : lamps) nearest = std::min(nearest, std::hypot(lamp.x_px - x_px, lamp.y_px - y_px));
  return nearest;
}

// A free place in the picture: lamps stand round the horizon, near ones higher above it, as street lights do.
void place_lamp(Lamp& lamp, const std::vector<Lamp>& others, double apart_px, Random& random) {
  const double lift_px =
      (lamp.height_m - 4) / lamp.distance_m * kFocalLengthPx;  // camera 4 m above the ground
  for (int attempt = 0;; ++attempt) {
    lamp.x_px = random.uniform(kEdgePx, kWidthPx - kEdgePx);
    const double horizon_px = 0.58 * kHeightPx + random.uniform(-40, 40);
    lamp.y_px = std::clamp(horizon_px - lift_px, kEdgePx, kHeightPx - kEdgePx);
    if (nearest_lamp_px(others, lamp.x_px, lamp.y_px) >= apart_px * std::pow(0.98, attempt)) return;
  }
}

bool in_catalogue(const NightOptions& options, const std::string& id) {
  return options.catalogue.empty() ||
         std::find(options.catalogue.begin(), options.catalogue.end(), id) != options.catalogue.end();
}

void add_catalogue_lamps(Night& night) {
  const std::vector<double> distances = lamp_distances(night.options);
  const double apart_px = std::clamp(260 / std::sqrt(static_cast<double>(distances.size())), 24.0, 90.0);
  Random random(night.options.seed, {kLamps});
  for (size_t i = 0; i < distances.size(); ++i) {
    Lamp lamp;
    lamp.id = "L" + std::to_string(i + 1);
    lamp.distance_m = distances[i];
    lamp.height_m = random.uniform(8, 13);
    lamp.intensity = std::exp(0.35 * random.normal());
    lamp.cutoff = night.options.luminaire == Luminaire::cutoff ||
                  (night.options.luminaire == Luminaire::mixed && i % 2 == 1);
    lamp.in_catalogue = in_catalogue(night.options, lamp.id);
    place_lamp(lamp, night.lamps, apart_px, random);
    night.lamps.push_back(lamp);
  }
  night.stray_from = static_cast<int>(night.lamps.size());
}

// Lamps that nobody surveyed: two always burn, one is switched on after a third of the night.
void add_stray_lights(Night& night) {
  Random random(night.options.seed, {kStray});
  for (int i = 0; i < kStrayLights; ++i) {
    Lamp lamp;
    lamp.id = "S" + std::to_string(i + 1);
    lamp.distance_m = std::exp(random.uniform(std::log(100.0), std::log(900.0)));
    lamp.height_m = random.uniform(5, 10);
    lamp.intensity = std::exp(0.35 * random.normal()) * 0.6;
    lamp.cutoff = night.options.luminaire == Luminaire::cutoff;
    lamp.in_catalogue = false;
    lamp.lit_from_frame = i == kStrayLights - 1 ? night.references + night.options.frames / 3 : 0;
    place_lamp(lamp, night.lamps, 30, random);
    night.lamps.push_back(lamp);
  }
}

// A first-order autoregressive series with standard deviation 1.
std::vector<double> wander(int count, double correlation, Random& random) {
  std::vector<double> series;
  double value = random.normal();
  for (int i = 0; i < count; ++i) {
    series.push_back(value);
    value = correlation * value + std::sqrt(1 - correlation * correlation) * random.normal();
  }
  return series;
}

Schedule schedule_of(Hours hours) {
  const TimePoint winter = sys_days{2026y / January / 15};
  const TimePoint spring = sys_days{2026y / March / 20};
  switch (hours) {
    case Hours::night:
      return {{winter + 17h + 30min, winter + 17h + 40min}, winter + 18h, 12h};
    case Hours::day:
      return {{spring - 14h, spring - 13h - 50min}, spring + 6h, 12h};
    case Hours::both:
      break;
  }
  return {{spring - 14h, spring - 13h - 50min, spring - 3h, spring - 2h - 50min}, spring + 12h, 24h};
}

int frames_a_night(const NightOptions& options) {
  return (options.frames + options.nights - 1) / options.nights;
}

void set_times(Night& night) {
  const Schedule schedule = schedule_of(night.options.hours);
  night.references = static_cast<int>(schedule.references.size());
  night.frames.resize(schedule.references.size() + static_cast<size_t>(night.options.frames));
  const int a_night = frames_a_night(night.options);
  const auto step = duration_cast<seconds>(schedule.length) / a_night;
  for (size_t i = 0; i < night.frames.size(); ++i) {
    const bool reference = i < schedule.references.size();
    Frame& frame = night.frames[i];
    frame.role = reference ? FrameRole::clear_reference : FrameRole::observation;
    if (reference) {
      frame.time_utc = schedule.references[i];
      continue;
    }
    const int number = static_cast<int>(i - schedule.references.size());
    frame.time_utc = schedule.first + days(number / a_night) + number % a_night * step;
  }
}

// From midnight to seven in the morning.
bool after_midnight(TimePoint time) {
  return time - floor<days>(time) < 7h;
}

// The clear nights first, then all the others as one.
std::vector<Air> draw_nights(const NightOptions& options, Random& random) {
  constexpr double kClearMor_m = 12000;
  const int clear = std::min(options.frames, options.clear_nights * frames_a_night(options));
  std::vector<Air> air;
  if (clear > 0)
    air = draw_weather(clear, std::max(kClearMor_m, options.mor_min_m), options.mor_max_m, random);
  if (clear < options.frames) {
    const std::vector<Air> rest =
        draw_weather(options.frames - clear, options.mor_min_m, options.mor_max_m, random);
    air.insert(air.end(), rest.begin(), rest.end());
  }
  return air;
}

void set_weather(Night& night) {
  Random random(night.options.seed, {kWeather});
  const double reference_mor_m = random.uniform(15000, 25000);
  const std::vector<Air> air = draw_nights(night.options, random);
  for (size_t i = 0; i < night.frames.size(); ++i) {
    Frame& frame = night.frames[i];
    const bool reference = frame.role == FrameRole::clear_reference;
    const Air sample = reference ? Air{Weather::clear, reference_mor_m, 0.55}
                                 : air[i - static_cast<size_t>(night.references)];
    frame.extinction_per_m = kMorTimesExtinction / sample.mor_m;
    frame.q = sample.q;
    frame.weather = sample.weather;
  }
}

// What fog sends back of the town's light: up to eight times the clear sky, and its own slow changes.
void set_sky(Night& night) {
  Random random(night.options.seed, {kSky});
  const std::vector<double> change = wander(static_cast<int>(night.frames.size()), 0.8, random);
  for (size_t i = 0; i < night.frames.size(); ++i) {
    Frame& frame = night.frames[i];
    const double fogged = 1 - std::exp(-150 * frame.extinction_per_m);
    frame.sky_electrons_per_s = kClearSkyElectronsPerS * (1 + 7 * fogged) * std::exp(0.15 * change[i]);
  }
}

void set_drifts(Night& night) {
  const int count = static_cast<int>(night.frames.size());
  Random gain_random(night.options.seed, {kGain});
  const std::vector<double> gain = wander(count, 0.8, gain_random);
  for (Frame& frame : night.frames) frame.lamp_strength.assign(night.lamps.size(), 1.0);
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    Random random(night.options.seed, {kDrift, l});
    const std::vector<double> drift = wander(count, 0.7, random);
    for (size_t i = 0; i < night.frames.size(); ++i) {
      const double share = night.frames[i].role == FrameRole::clear_reference ? 0.01 : 0.06;
      if (night.options.nuisances.lamp_drift) night.frames[i].lamp_strength[l] = std::exp(share * drift[i]);
    }
  }
  for (size_t i = 0; i < night.frames.size(); ++i) {
    const double share = night.frames[i].role == FrameRole::clear_reference ? 0.01 : 0.12;
    if (night.options.nuisances.gain_drift) night.frames[i].gain = std::exp(share * gain[i]);
  }
}

// What nobody undoes from night to night, unlike the drifts, which come back.
void wear(Night& night) {
  for (size_t i = static_cast<size_t>(night.references); i < night.frames.size(); ++i) {
    Frame& frame = night.frames[i];
    const double part =
        static_cast<double>(i - static_cast<size_t>(night.references) + 1) / night.options.frames;
    frame.gain *= 1 - night.options.dirt * part;
    for (double& strength : frame.lamp_strength) strength *= 1 - night.options.ageing * part;
  }
}

// Each street's circuit dims or not; with all of it, all lamps may dim together.
void dim_after_midnight(Night& night) {
  Random random(night.options.seed, {kDimming});
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    if (!random.chance(0.6)) continue;
    for (Frame& frame : night.frames) {
      if (after_midnight(frame.time_utc) && frame.role == FrameRole::observation)
        frame.lamp_strength[l] *= 0.5;
    }
  }
}

// One lamp of seven is out for a sixth of the night, one flickers out now and then.
void switch_lamps_off(Night& night) {
  Random random(night.options.seed, {kOutages});
  const int count = night.options.frames;
  const int broken = night.stray_from >= 2 ? std::max(1, night.stray_from / 7) : 0;
  for (int k = 0; k < broken; ++k) {
    const auto lamp = static_cast<size_t>(random.below(night.stray_from));
    const auto flickering = static_cast<size_t>(random.below(night.stray_from));
    const int first = random.below(count);
    for (int i = 0; i < count; ++i) {
      Frame& frame = night.frames[static_cast<size_t>(night.references) + static_cast<size_t>(i)];
      if (i >= first && i < first + count / 6) frame.lamp_strength[lamp] = 0;
      if (random.chance(0.03)) frame.lamp_strength[flickering] = 0;
    }
  }
  for (size_t l = 0; l < night.lamps.size(); ++l) {
    for (size_t i = 0; i < night.frames.size(); ++i) {
      if (static_cast<int>(i) < night.lamps[l].lit_from_frame) night.frames[i].lamp_strength[l] = 0;
    }
  }
}

void shake_camera(Night& night) {
  Random random(night.options.seed, {kShake});
  for (Frame& frame : night.frames) {
    const double share = frame.role == FrameRole::clear_reference ? 0.1 : 1;
    frame.shift_x_px = share * 2.5 / std::sqrt(2.0) * random.normal();
    frame.shift_y_px = share * 2.5 / std::sqrt(2.0) * random.normal();
    frame.rotation_rad = share * 0.0006 * random.normal();
  }
}

// Head lamps in a third of the frames, on a road that crosses the picture below the horizon.
void drive_cars(Night& night) {
  Random random(night.options.seed, {kCars});
  for (Frame& frame : night.frames) {
    const int cars = random.chance(0.33) ? 1 + random.below(2) : 0;
    for (int i = 0; i < cars; ++i) {
      Car car;
      car.distance_m = random.uniform(90, 400);
      car.x_px = random.uniform(0, kWidthPx);
      car.y_px = 0.6 * kHeightPx + 3 / car.distance_m * kFocalLengthPx;
      car.intensity = random.uniform(0.3, 2);
      car.spacing_px = 1.4 / car.distance_m * kFocalLengthPx;
      car.speed_px_per_s = random.uniform(-14, 14) / car.distance_m * kFocalLengthPx;
      if (frame.role == FrameRole::observation) frame.cars.push_back(car);
    }
  }
}

}  // namespace

Night plan_night(const NightOptions& options) {
  Night night;
  night.options = options;
  set_times(night);
  add_catalogue_lamps(night);
  if (options.nuisances.stray_lights) add_stray_lights(night);
  set_weather(night);
  set_sky(night);
  set_drifts(night);
  wear(night);
  if (options.nuisances.dimming) dim_after_midnight(night);
  if (options.nuisances.outages) switch_lamps_off(night);
  if (options.nuisances.shake) shake_camera(night);
  if (options.nuisances.cars) drive_cars(night);
  if (options.hours != Hours::night) add_daylight(night);
  if (options.hours != Hours::night) add_events(night);
  return night;
}

}  // namespace lampglow::simulation
