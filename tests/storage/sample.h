// Sites and frame results with every field filled, for storage and web tests.
#pragma once

#include "estimator/observation.h"
#include "estimator/site.h"

namespace lampglow::testing_support {

inline TimePoint at(const char* text) {
  return parse_time_utc(text).value();
}

inline Site harbour() {
  Site site;
  site.name = "harbour";
  site.latitude_deg = 52.1;
  site.longitude_deg = 5.18;
  site.elevation_m = 10;
  site.camera.width_px = 760;
  site.camera.height_px = 504;
  site.camera.focal_length_px = 1044;
  site.lights = {
      {"L1", 96.3, 214.7, 60.0, {}}, {"L2", 300.5, 180.5, 250.0, 5.0}, {"L3", 610.0, 190.0, {}, {}}};
  return site;
}

inline FrameResult foggy(TimePoint time, double extinction_per_m = 0.012) {
  FrameResult frame;
  Observation& o = frame.observation;
  o.time_utc = time;
  o.extinction_per_m = extinction_per_m;
  o.extinction_low_per_m = extinction_per_m * 0.9;
  o.extinction_high_per_m = extinction_per_m * 1.1;
  o.q = 0.87;
  o.q_low = 0.84;
  o.q_high = 0.9;
  o.weather = Weather::fog;
  o.weather_probability = {0, 0.01, 0.04, 0.15, 0.75, 0.05};
  o.lecture_class = Weather::fog;
  o.wmo_4680 = 30;
  o.relative_humidity = 0.99;
  o.method = Method::glow;
  o.lights_used = 2;
  o.quality.set(Quality::few_lights);
  frame.shift_x_px = 0.25;
  frame.shift_y_px = -1.5;
  frame.rotation_rad = 0.001;
  LampFit first;
  first.id = "L1";
  first.state = LampState::seen;
  first.x_px = 96.5;
  first.y_px = 213.25;
  first.distance_m = 60;
  first.strength_ratio = 0.97;
  first.optical_thickness = extinction_per_m * 60;
  first.residual_rms = 1.125;
  first.ln_halo = -0.0625;
  first.ln_halo_sigma = 0.03125;
  first.profile = {{0.25, 0.5, 1}, {100, 50, 25}, {1, 0.5, 0.25}, {101, 49.5, 25.5}};
  LampFit second;
  second.id = "L2";
  second.state = LampState::faded;
  second.x_px = 300.75;
  second.y_px = 179;
  frame.lamps = {first, second};
  return frame;
}

inline FrameResult without_value(TimePoint time) {
  FrameResult frame;
  frame.observation.time_utc = time;
  frame.observation.quality.set(Quality::daylight);
  frame.reason = "daylight";
  return frame;
}

}  // namespace lampglow::testing_support
