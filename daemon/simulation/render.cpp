#include "daemon/simulation/render.h"

#include <algorithm>
#include <cmath>
#include "daemon/simulation/cutoff.h"
#include "daemon/simulation/daylight.h"

namespace lampglow::simulation {

namespace {

constexpr double kFocalPx = kFocalLengthPx;
constexpr int kCanvasWidthPx = kWidthPx + 2 * kMarginPx;
constexpr int kCanvasHeightPx = kHeightPx + 2 * kMarginPx;
constexpr double kCuspPx = 4;    // nearer to a lamp than this, a pixel's light is a mean of many points
constexpr int kCuspSamples = 8;  // in x and in y

struct Ray {
  double x = 0, y = 0, z = 0;
};

Ray ray_of(double x_px, double y_px) {
  const double x = (x_px - kWidthPx / 2.0) / kFocalPx;
  const double y = (y_px - kHeightPx / 2.0) / kFocalPx;
  const double scale = 1 / std::sqrt(x * x + y * y + 1);
  return {x * scale, y * scale, scale};
}

// ln of the angle between two rays; from the chord, which keeps its digits at small angles.
double ln_angle(const Ray& a, const Ray& b) {
  const double chord_squared =
      (a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) + (a.z - b.z) * (a.z - b.z);
  const double half = chord_squared / 4;  // sin²(θ/2)
  return 0.5 * std::log(chord_squared) +
         half * (1.0 / 6 + half * 3.0 / 40);  // ln 2 asin(chord/2), |error| < 1e-3 at 60°
}

// The solid angle of the middle pixel over that of the pixel here: a pixel at the edge sees less, so the same
// irradiance of a point is a higher radiance there. (No vignetting: equal radiance gives equal signal.)
double radiance_per_irradiance(double x_px, double y_px) {
  const double z = ray_of(x_px, y_px).z;
  return 1 / (z * z * z);
}

Image<double> crop(const Image<double>& canvas) {
  Image<double> picture(kWidthPx, kHeightPx);
  for (int row = 0; row < kHeightPx; ++row) {
    for (int column = 0; column < kWidthPx; ++column) {
      picture.at(column, row) = std::max(0.0, canvas.at(column + kMarginPx, row + kMarginPx));
    }
  }
  return picture;
}

}  // namespace

PixelPosition shaken(const Frame& frame, double x_px, double y_px) {
  const double x = x_px - kWidthPx / 2.0;
  const double y = y_px - kHeightPx / 2.0;
  const double cosine = std::cos(frame.rotation_rad);
  const double sine = std::sin(frame.rotation_rad);
  return {kWidthPx / 2.0 + cosine * x - sine * y + frame.shift_x_px,
          kHeightPx / 2.0 + sine * x + cosine * y + frame.shift_y_px};
}

double lamp_electrons_per_s(const Night& night, const Frame& frame, size_t lamp) {
  const double nearness = kLampReferenceDistance_m / night.lamps[lamp].distance_m;
  const double towards = night.lamps[lamp].cutoff ? cutoff_intensity(night.lamps[lamp]) : 1;
  return kLampElectronsPerS * towards * night.lamps[lamp].intensity * nearness * nearness *
         frame.lamp_strength[lamp] * frame.gain;
}

Renderer::Renderer(const Night& night, const HaloLibrary& halos)
    : night_(night), halos_(halos), lens_(spread_, kCanvasWidthPx, kCanvasHeightPx) {}

// By night alone: brighter towards the horizon, and no skyline.
void Renderer::add_sky(Image<double>& canvas, const Frame& frame) const {
  if (!night_.targets.empty()) return add_skyline(canvas, night_, frame, kMarginPx);
  for (int row = 0; row < canvas.height_px; ++row) {
    const double height = (row + 0.5 - kMarginPx) / kHeightPx - 0.5;
    const double sky = frame.sky_electrons_per_s * frame.gain * (1 + 0.3 * height);
    for (int column = 0; column < canvas.width_px; ++column) canvas.at(column, row) += sky;
  }
}

void Renderer::add_halo(Image<double>& canvas, const HaloProfile& halo, PixelPosition lamp,
                        double electrons_per_s) const {
  if (halo.dark() || electrons_per_s <= 0) return;
  const double scale = electrons_per_s / (kFocalPx * kFocalPx);  // the middle pixel's solid angle is 1/f²
  const Ray to_lamp = ray_of(lamp.x_px, lamp.y_px);
  for (int row = 0; row < canvas.height_px; ++row) {
    for (int column = 0; column < canvas.width_px; ++column) {
      const double x = column - kMarginPx;
      const double y = row - kMarginPx;
      const bool cusp = std::hypot(x + 0.5 - lamp.x_px, y + 0.5 - lamp.y_px) < kCuspPx;
      const int samples = cusp ? kCuspSamples : 1;
      double sum = 0;
      for (int i = 0; i < samples * samples; ++i) {
        const int across = i % samples, down = i / samples;
        const double sub_x = x + (across + 0.5) / samples;
        const double sub_y = y + (down + 0.5) / samples;
        const double azimuth = halo.even() ? 0 : std::atan2(sub_x - lamp.x_px, lamp.y_px - sub_y);
        sum += halo.radiance(std::max(ln_angle(ray_of(sub_x, sub_y), to_lamp), -12.0), azimuth);
      }
      canvas.at(column, row) += scale * sum / (samples * samples);
    }
  }
}

HaloProfile Renderer::halo_of_lamp(const Frame& frame, size_t lamp) const {
  if (frame.lamp_strength[lamp] <= 0) return {};
  if (night_.lamps[lamp].cutoff) return cutoff_halo(night_, frame, lamp);
  return halos_.profile(frame.q, frame.extinction_per_m * night_.lamps[lamp].distance_m);
}

Image<double> Renderer::still_scene(const Frame& frame) const {
  Image<double> canvas(kCanvasWidthPx, kCanvasHeightPx);
  add_sky(canvas, frame);
  for (size_t l = 0; l < night_.lamps.size(); ++l) {
    const Lamp& lamp = night_.lamps[l];
    add_halo(canvas, halo_of_lamp(frame, l), shaken(frame, lamp.x_px, lamp.y_px),
             lamp_electrons_per_s(night_, frame, l));
  }
  lens_.blur(canvas);
  Image<double> picture = crop(canvas);
  for (size_t l = 0; l < night_.lamps.size(); ++l) {
    const Lamp& lamp = night_.lamps[l];
    const PixelPosition at = shaken(frame, lamp.x_px, lamp.y_px);
    const double direct = std::exp(-frame.extinction_per_m * lamp.distance_m);
    add_point(picture, spread_, at.x_px, at.y_px,
              lamp_electrons_per_s(night_, frame, l) * direct * radiance_per_irradiance(at.x_px, at.y_px));
  }
  return picture;
}

// A moving lamp draws a streak of touching points; its halo and glare are so wide that a few places do.
void Renderer::add_cars(Image<double>& picture, const Frame& frame, double start_s, double end_s) const {
  for (const Car& car : frame.cars) {
    const double nearness = kLampReferenceDistance_m / car.distance_m;
    const double electrons = kLampElectronsPerS * car.intensity * nearness * nearness * frame.gain;
    const double thickness = frame.extinction_per_m * car.distance_m;
    const double middle_px = car.x_px + car.speed_px_per_s * 0.5 * (start_s + end_s);
    Image<double> canvas(kCanvasWidthPx, kCanvasHeightPx);
    add_halo(canvas, halos_.profile(frame.q, thickness), shaken(frame, middle_px, car.y_px), 2 * electrons);
    lens_.blur(canvas);
    const Image<double> glow = crop(canvas);
    for (size_t i = 0; i < picture.pixels.size(); ++i) picture.pixels[i] += glow.pixels[i];
    const double direct = electrons * std::exp(-thickness);
    const double length_px = std::abs(car.speed_px_per_s) * (end_s - start_s);
    const int steps = std::clamp(static_cast<int>(std::ceil(length_px)), 1, 400);
    const int steps_per_glare = (steps + 3) / 4;
    for (const double side : {-0.5, 0.5}) {
      for (int step = 0; step < steps; ++step) {
        const double time_s = start_s + (end_s - start_s) * (step + 0.5) / steps;
        const double x_px = car.x_px + car.speed_px_per_s * time_s + side * car.spacing_px;
        const PixelPosition at = shaken(frame, x_px, car.y_px);
        add_core(picture, spread_, at.x_px, at.y_px, direct / steps);
        const int left = std::min(steps_per_glare, steps - step);
        if (step % steps_per_glare == 0) add_glare(picture, spread_, at.x_px, at.y_px, direct * left / steps);
      }
    }
  }
}

}  // namespace lampglow::simulation
