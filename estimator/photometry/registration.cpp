#include "estimator/photometry/registration.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "estimator/photometry/median.h"

namespace lampglow::photometry {
namespace {

// frame = centre + R·(reference - centre) + shift, with what is known about it.
struct Transform {
  double shift_x = 0, shift_y = 0, rotation = 0;
  double centre_x = 0, centre_y = 0;
  double shift_sigma = 0, rotation_sigma = 0;

  std::array<double, 2> apply(double x, double y) const {
    const double c = std::cos(rotation), s = std::sin(rotation), dx = x - centre_x, dy = y - centre_y;
    return {centre_x + c * dx - s * dy + shift_x, centre_y + s * dx + c * dy + shift_y};
  }
};

// A catalogue lamp and a light taken for it.
struct Match {
  size_t lamp;
  double x, y, sigma;
};

// How well a transform brings the catalogue onto the lights: each lamp gives up to 1, less the farther its
// nearest light, and the prior takes off what an unusual shift is worth.
double score(const Transform& t, std::span<const CatalogueLamp> catalogue,
             std::span<const DetectedLight> lights, const RegistrationOptions& options) {
  double total = 0;
  for (const CatalogueLamp& lamp : catalogue) {
    const auto [x, y] = t.apply(lamp.x_px, lamp.y_px);
    const double tolerance = options.match_px + lamp.position_sigma_px;
    double best = 0;
    for (const DetectedLight& light : lights) {
      const double part =
          1 - (std::pow(light.x_px - x, 2) + std::pow(light.y_px - y, 2)) / (tolerance * tolerance);
      if (part <= best) continue;
      // Where the catalogue knows how bright the lamp is, a light far brighter than that is another.
      const bool too_bright =
          lamp.core_flux && light.flux > 5 * *lamp.core_flux && light.saturated_pixels == 0;
      best = too_bright ? std::max(best, 0.3 * part) : part;
    }
    total += best;
  }
  const double shift = std::hypot(t.shift_x, t.shift_y) / options.usual_shift_px;
  const double turn = t.rotation / options.usual_rotation_rad;
  return total - 0.1 * (shift * shift + turn * turn) / 2;
}

// The best shift and rotation among those that bring one lamp onto one light.
Transform vote(std::span<const CatalogueLamp> catalogue, std::span<const DetectedLight> lights,
               Transform start, const RegistrationOptions& options) {
  Transform best = start;
  double best_score = score(start, catalogue, lights, options);
  const size_t lamps = std::min<size_t>(catalogue.size(), 16);
  for (int turn = -3; turn <= 3; ++turn) {
    Transform trial = start;
    trial.rotation = turn * options.max_rotation_rad / 3;
    for (size_t i = 0; i < lamps; ++i) {
      trial.shift_x = trial.shift_y = 0;
      const auto [x, y] = trial.apply(catalogue[i].x_px, catalogue[i].y_px);
      for (const DetectedLight& light : lights) {
        trial.shift_x = light.x_px - x, trial.shift_y = light.y_px - y;
        if (std::hypot(trial.shift_x, trial.shift_y) > options.max_shift_px) continue;
        const double value = score(trial, catalogue, lights, options);
        if (value > best_score) best_score = value, best = trial;
      }
    }
  }
  return best;
}

// Robust least squares for shift and rotation: Gauss-Newton with Cauchy weights and priors. The rotation is
// small and its prior tight, so that one lamp alone gives a shift and leaves the rotation at zero.
Transform fit(std::span<const CatalogueLamp> catalogue, std::span<const Match> matches, Transform t,
              const RegistrationOptions& options) {
  for (int pass = 0; pass < 10; ++pass) {
    const double shift_weight = 1 / std::pow(options.max_shift_px, 2);
    double a00 = shift_weight, a11 = shift_weight, a02 = 0, a12 = 0,
           a22 = 1 / std::pow(options.usual_rotation_rad, 2);
    double b0 = -t.shift_x * shift_weight, b1 = -t.shift_y * shift_weight, b2 = -t.rotation * a22;
    for (const Match& match : matches) {
      const CatalogueLamp& lamp = catalogue[match.lamp];
      const auto [x, y] = t.apply(lamp.x_px, lamp.y_px);
      const double rx = match.x - x, ry = match.y - y;
      const double variance = match.sigma * match.sigma + lamp.position_sigma_px * lamp.position_sigma_px;
      const double w = 1 / (variance * (1 + (rx * rx + ry * ry) / (4 * variance)));      // Cauchy, at 2 sigma
      const double jx = -(y - t.centre_y - t.shift_y), jy = x - t.centre_x - t.shift_x;  // d/d rotation
      a00 += w, a11 += w, a02 += w * jx, a12 += w * jy, a22 += w * (jx * jx + jy * jy);
      b0 += w * rx, b1 += w * ry, b2 += w * (jx * rx + jy * ry);
    }
    // Eliminate the two shifts, then the rotation is one division.
    const double pivot = a22 - a02 * a02 / a00 - a12 * a12 / a11;
    const double turn = (b2 - a02 * b0 / a00 - a12 * b1 / a11) / pivot;
    t.rotation = std::clamp(t.rotation + turn, -options.max_rotation_rad, options.max_rotation_rad);
    t.shift_x += (b0 - a02 * turn) / a00;
    t.shift_y += (b1 - a12 * turn) / a11;
    t.rotation_sigma = 1 / std::sqrt(pivot);
    t.shift_sigma = std::sqrt(0.5 * (1 / a00 + 1 / a11) +
                              0.5 * (std::pow(a02 / a00, 2) + std::pow(a12 / a11, 2)) / pivot);
  }
  return t;
}

bool in_picture(const RadianceImage& image, double x, double y, double margin) {
  return x >= margin && y >= margin && x < image.radiance.width_px - margin &&
         y < image.radiance.height_px - margin;
}

// Lights that the lamps of the catalogue have under a transform: each measured near where it should be.
std::vector<Match> match_near(const RadianceImage& image, std::span<const CatalogueLamp> catalogue,
                              const Transform& t, const CentroidOptions& centroid, double gate_px,
                              double least_snr, double extra_sigma_px) {
  std::vector<Match> matches;
  for (size_t i = 0; i < catalogue.size(); ++i) {
    const auto [x, y] = t.apply(catalogue[i].x_px, catalogue[i].y_px);
    if (!in_picture(image, x, y, 2)) continue;
    const DetectedLight light = measure_light(image, x, y, centroid);
    if (light.snr < least_snr || light.position_sigma_px > 0.3 * gate_px) continue;
    if (std::hypot(light.x_px - x, light.y_px - y) > gate_px + 2 * catalogue[i].position_sigma_px) continue;
    matches.push_back({i, light.x_px, light.y_px, std::hypot(light.position_sigma_px, extra_sigma_px)});
  }
  return matches;
}

// Where the cores have vanished, the halo is still centred on the lamp: the same with wide windows, widest
// first.
std::vector<Match> match_halos(const RadianceImage& image, std::span<const CatalogueLamp> catalogue,
                               const Transform& start, const RegistrationOptions& options) {
  std::vector<Match> matches;
  for (const double window_px : {6.0, 3.0}) {
    CentroidOptions wide = options.centroid;
    wide.window_sigma_px = window_px;
    wide.search_px = options.max_shift_px;
    matches = match_near(image, catalogue, start, wide, options.max_shift_px, 8, 0.15 * window_px);
    if (!matches.empty() && window_px < 4) break;
    if (matches.empty()) continue;
  }
  return matches;
}

// What one lamp looks like at its place.
LampSighting sight(const RadianceImage& image, const CatalogueLamp& lamp, const Transform& t,
                   const RegistrationOptions& options) {
  LampSighting sighting;
  sighting.id = lamp.id;
  const auto [x, y] = t.apply(lamp.x_px, lamp.y_px);
  sighting.x_px = x, sighting.y_px = y;
  const double predicted = std::hypot(t.shift_sigma, lamp.position_sigma_px,
                                      t.rotation_sigma * std::hypot(x - t.centre_x, y - t.centre_y));
  sighting.position_sigma_px = predicted;
  if (!in_picture(image, x, y, 1)) return sighting;

  const DetectedLight own = measure_light(image, x, y, options.centroid);
  const double away = std::hypot(own.x_px - x, own.y_px - y);
  if (own.snr > 5 && own.position_sigma_px < 0.7 &&
      away < 3 * std::hypot(predicted, own.position_sigma_px) + 0.1) {
    // Both know something: weighted mean.
    const double w = 1 / std::pow(own.position_sigma_px, 2), v = 1 / std::pow(predicted, 2);
    sighting.x_px = (w * own.x_px + v * x) / (w + v);
    sighting.y_px = (w * own.y_px + v * y) / (w + v);
    sighting.position_sigma_px = 1 / std::sqrt(w + v);
    sighting.own_centroid = true;
  }
  DetectedLight core;
  measure_flux(image, sighting.x_px, sighting.y_px, options.centroid.aperture_px, 3, core);
  sighting.core_flux = core.flux, sighting.core_flux_sigma = core.flux_sigma;
  sighting.background = core.background, sighting.peak = core.peak;
  sighting.saturated_pixels = core.saturated_pixels;
  sighting.snr = core.flux_sigma > 0 ? core.flux / core.flux_sigma : 0;
  return sighting;
}

// Is the ring around the core brighter than the surroundings farther out? Then there is a halo.
bool has_halo(const RadianceImage& image, double x, double y, double aperture_px) {
  DetectedLight halo;
  measure_flux(image, x, y, 4 * aperture_px, 6, halo);
  return halo.flux > 8 * halo.flux_sigma;
}

LampState state_of(const RadianceImage& image, const LampSighting& sighting, double aperture_px) {
  if (!in_picture(image, sighting.x_px, sighting.y_px, 1)) return LampState::unknown;
  if (sighting.saturated_pixels > 0) return LampState::saturated;
  if (sighting.own_centroid && sighting.snr > 5) return LampState::seen;
  return has_halo(image, sighting.x_px, sighting.y_px, aperture_px) ? LampState::faded : LampState::off;
}

void keep_strays(std::span<const DetectedLight> lights, double match_px, RegisteredFrame& frame) {
  for (const DetectedLight& light : lights) {
    const bool known = std::any_of(frame.lamps.begin(), frame.lamps.end(), [&](const LampSighting& lamp) {
      // The glare of a saturated lamp is ragged, and its pieces are not lights of their own.
      const double reach = match_px + 1.5 * std::sqrt(static_cast<double>(lamp.saturated_pixels));
      return std::hypot(light.x_px - lamp.x_px, light.y_px - lamp.y_px) < reach;
    });
    if (!known) frame.strays.push_back(light);
  }
}

// Without strays to report, lights are looked for only where a lamp may be.
std::vector<DetectedLight> lights_near(const RadianceImage& image, std::span<const CatalogueLamp> catalogue,
                                       const RegistrationOptions& options) {
  std::vector<DetectedLight> lights;
  CentroidOptions wide = options.centroid;
  wide.window_sigma_px = 0.5 * options.max_shift_px;
  wide.search_px = options.max_shift_px;
  for (const CatalogueLamp& lamp : catalogue) {
    const DetectedLight rough = measure_light(image, lamp.x_px, lamp.y_px, wide);
    const DetectedLight light = measure_light(image, rough.x_px, rough.y_px, options.centroid);
    if (light.snr > 5) lights.push_back(light);
  }
  return lights;
}

}  // namespace

std::vector<CatalogueLamp> catalogue_of(const Site& site) {
  std::vector<CatalogueLamp> catalogue;
  for (const Light& light : site.lights) {
    CatalogueLamp lamp;
    lamp.id = light.id, lamp.x_px = light.x_px, lamp.y_px = light.y_px;
    catalogue.push_back(lamp);
  }
  return catalogue;
}

void RegisteredFrame::to_frame(double& x_px, double& y_px, int width_px, int height_px) const {
  Transform t;
  t.shift_x = shift_x_px, t.shift_y = shift_y_px, t.rotation = rotation_rad;
  t.centre_x = 0.5 * width_px, t.centre_y = 0.5 * height_px;
  const auto [x, y] = t.apply(x_px, y_px);
  x_px = x, y_px = y;
}

RegisteredFrame register_frame(const RadianceImage& image, std::span<const CatalogueLamp> catalogue,
                               const RegistrationOptions& options) {
  RegisteredFrame frame;
  if (image.empty()) return frame;
  Transform start;
  start.centre_x = 0.5 * image.radiance.width_px, start.centre_y = 0.5 * image.radiance.height_px;
  const std::vector<DetectedLight> lights =
      options.find_strays ? detect_lights(image, options.detection) : lights_near(image, catalogue, options);
  Transform t = vote(catalogue, lights, start, options);
  std::vector<Match> matches;
  for (int pass = 0; pass < 3; ++pass) {
    matches = match_near(image, catalogue, t, options.centroid, options.match_px, 6, 0);
    if (matches.empty()) break;
    t = fit(catalogue, matches, t, options);
  }
  if (matches.empty()) {
    matches = match_halos(image, catalogue, start, options);
    t = matches.empty() ? start : fit(catalogue, matches, start, options);
  }
  frame.registered = !matches.empty();
  frame.lamps_used = static_cast<int>(matches.size());
  if (!frame.registered)
    t.shift_sigma = options.usual_shift_px, t.rotation_sigma = options.usual_rotation_rad;
  frame.shift_x_px = t.shift_x, frame.shift_y_px = t.shift_y, frame.rotation_rad = t.rotation;
  frame.shift_sigma_px = t.shift_sigma, frame.rotation_sigma_rad = t.rotation_sigma;
  for (const CatalogueLamp& lamp : catalogue) {
    frame.lamps.push_back(sight(image, lamp, t, options));
    frame.lamps.back().state = state_of(image, frame.lamps.back(), options.centroid.aperture_px);
  }
  if (options.find_strays) keep_strays(lights, options.match_px, frame);
  return frame;
}

std::vector<CatalogueLamp> refine_catalogue(std::span<const CatalogueLamp> catalogue,
                                            std::span<const RegisteredFrame> clear, int width_px,
                                            int height_px) {
  std::vector<CatalogueLamp> refined(catalogue.begin(), catalogue.end());
  for (size_t i = 0; i < refined.size(); ++i) {
    std::vector<double> x, y, flux, sigma;
    for (const RegisteredFrame& frame : clear) {
      if (!frame.registered || !frame.lamps[i].own_centroid) continue;
      const LampSighting& lamp = frame.lamps[i];
      // Back to the reference: undo the shift, then turn the other way.
      const double c = std::cos(frame.rotation_rad), s = std::sin(frame.rotation_rad);
      const double dx = lamp.x_px - frame.shift_x_px - 0.5 * width_px,
                   dy = lamp.y_px - frame.shift_y_px - 0.5 * height_px;
      x.push_back(0.5 * width_px + c * dx + s * dy);
      y.push_back(0.5 * height_px - s * dx + c * dy);
      flux.push_back(lamp.core_flux);
      sigma.push_back(std::hypot(lamp.position_sigma_px, 0));
    }
    if (x.empty()) continue;
    refined[i].x_px = median_of(x), refined[i].y_px = median_of(y);
    refined[i].core_flux = median_of(flux);
    refined[i].position_sigma_px =
        std::max(0.03, 1.25 * median_of(sigma) / std::sqrt(static_cast<double>(x.size())));
  }
  return refined;
}

std::vector<DetectedLight> moving_lights(const RegisteredFrame& before, const RegisteredFrame& now,
                                         double least_px, double most_px) {
  const double dx = now.shift_x_px - before.shift_x_px, dy = now.shift_y_px - before.shift_y_px;
  std::vector<DetectedLight> moving;
  for (const DetectedLight& light : now.strays) {
    bool stayed = false, near = false;
    for (const DetectedLight& other : before.strays) {
      const double way = std::hypot(light.x_px - other.x_px - dx, light.y_px - other.y_px - dy);
      stayed = stayed || way < least_px;
      near = near || (way >= least_px && way <= most_px);
    }
    if (near && !stayed) moving.push_back(light);
  }
  return moving;
}

}  // namespace lampglow::photometry
