#include "daemon/simulation/sensor.h"

#include <algorithm>
#include <cmath>

namespace lampglow::simulation {

namespace {

constexpr int kHotPixels = 45;

// IEC 61966-2-1, from linear 0..1 to 0..1.
double srgb_curve(double linear) {
  return linear <= 0.0031308 ? 12.92 * linear : 1.055 * std::pow(linear, 1 / 2.4) - 0.055;
}

double srgb_slope(double linear) {
  return linear <= 0.0031308 ? 12.92 : 1.055 / 2.4 * std::pow(linear, 1 / 2.4 - 1);
}

double linear_signal(double electrons, const Sensor& sensor, Random& random) {
  return random.poisson(electrons) * sensor.gain_dn_per_electron + sensor.read_noise_dn * random.normal();
}

std::uint16_t to_dn(double signal_dn, const Sensor& sensor) {
  const double top = sensor.saturation_dn;
  if (!sensor.srgb) {
    return static_cast<std::uint16_t>(std::clamp(std::round(signal_dn + sensor.black_level_dn), 0.0, top));
  }
  return static_cast<std::uint16_t>(std::round(top * srgb_curve(std::clamp(signal_dn / top, 0.0, 1.0))));
}

}  // namespace

Sensor bracket_sensor() {
  return {};
}

// Its linear signal is counted in units of the 8-bit range: 255 is full.
Sensor webcam_sensor() {
  return {.bit_depth = 8,
          .black_level_dn = 0,
          .saturation_dn = 255,
          .gain_dn_per_electron = 255.0 / 10000,
          .read_noise_dn = 0.12,
          .srgb = true};
}

std::vector<HotPixel> draw_hot_pixels(int width_px, int height_px, Random& random) {
  std::vector<HotPixel> pixels;
  for (int i = 0; i < kHotPixels; ++i) {
    const double rate = std::exp(random.uniform(std::log(300.0), std::log(60000.0)));
    pixels.push_back({random.below(width_px), random.below(height_px), rate});
  }
  return pixels;
}

Image<std::uint16_t> expose(const Image<double>& electrons_per_s, double exposure_s, const Sensor& sensor,
                            const std::vector<HotPixel>& hot_pixels, Random& random) {
  Image<std::uint16_t> picture(electrons_per_s.width_px, electrons_per_s.height_px);
  for (size_t i = 0; i < picture.pixels.size(); ++i) {
    picture.pixels[i] = to_dn(linear_signal(electrons_per_s.pixels[i] * exposure_s, sensor, random), sensor);
  }
  for (const HotPixel& hot : hot_pixels) {
    const double rate = electrons_per_s.at(hot.column, hot.row) + hot.electrons_per_s;
    picture.at(hot.column, hot.row) = to_dn(linear_signal(rate * exposure_s, sensor, random), sensor);
  }
  return picture;
}

double noise_variance(const Sensor& sensor, double electrons) {
  const double read = sensor.read_noise_dn / sensor.gain_dn_per_electron;
  const double full = sensor.saturation_dn / sensor.gain_dn_per_electron;
  const double slope = sensor.srgb ? srgb_slope(std::clamp(electrons / full, 0.0, 1.0)) : 1;
  const double step =
      1 / (slope * sensor.gain_dn_per_electron);  // electrons that one step of the picture spans
  return electrons + read * read + step * step / 12;
}

double saturation_electrons(const Sensor& sensor) {
  return (sensor.saturation_dn - sensor.black_level_dn) / sensor.gain_dn_per_electron;
}

}  // namespace lampglow::simulation
