#include "estimator/inference/contrast_day.h"

#include <algorithm>
#include <cmath>

#include "estimator/inference/day_hypotheses.h"
#include "estimator/inference/weather.h"
#include "estimator/inference/window.h"

namespace lampglow::inference {
namespace {

// The best point between grid points: the parabola through the least and its neighbours.
double refined_mode(const std::vector<PosteriorPoint>& p) {
  const auto best =
      static_cast<size_t>(std::min_element(p.begin(), p.end(),
                                           [](const auto& a, const auto& b) {
                                             return a.minus_ln_probability < b.minus_ln_probability;
                                           }) -
                          p.begin());
  if (best == 0 || best + 1 == p.size()) return p[best].ln_sigma;
  const double a = p[best - 1].minus_ln_probability, b = p[best].minus_ln_probability,
               c = p[best + 1].minus_ln_probability, curvature = a - 2 * b + c;
  const double shift = curvature > 0 ? std::clamp(0.5 * (a - c) / curvature, -0.5, 0.5) : 0.0;
  return p[best].ln_sigma + shift * (p[best + 1].ln_sigma - p[best].ln_sigma);
}

// σ below which a part of the posterior's probability lies.
double quantile_of(const std::vector<PosteriorPoint>& p, double part) {
  double least = p[0].minus_ln_probability, total = 0, sum = 0;
  for (const PosteriorPoint& point : p) least = std::min(least, point.minus_ln_probability);
  for (const PosteriorPoint& point : p) total += std::exp(least - point.minus_ln_probability);
  for (const PosteriorPoint& point : p) {
    sum += std::exp(least - point.minus_ln_probability);
    if (sum >= part * total) return std::exp(point.ln_sigma);
  }
  return std::exp(p.back().ln_sigma);
}

SigmaBounds dense_fog(const std::vector<PosteriorPoint>& posterior) {
  SigmaBounds bounds;
  bounds.low = quantile_of(posterior, 0.025);
  bounds.value = quantile_of(posterior, 0.5);
  bounds.high = quantile_of(posterior, 0.975);
  bounds.ln_sd = 0.25 * std::log(*bounds.high / *bounds.low);
  return bounds;
}

void fill_bounds(const SigmaBounds& bounds, double mode, Observation& observation) {
  observation.limit = bounds.limit;
  observation.extinction_per_m = bounds.limit == Limit::none ? std::exp(mode) : bounds.value;
  observation.extinction_low_per_m = bounds.low;
  observation.extinction_high_per_m = bounds.high;
  if (bounds.limit == Limit::above) observation.quality.set(Quality::limit_above);
  if (bounds.limit == Limit::below) observation.quality.set(Quality::limit_below);
}

void fill_weather(const SigmaBounds& bounds, std::optional<double> humidity, Observation& observation) {
  AirEstimate air;
  air.ln_sigma = std::log(*observation.extinction_per_m);
  air.ln_sigma_sd = bounds.ln_sd;
  air.relative_humidity = humidity;
  air.limit = bounds.limit;
  observation.weather_probability = weather_probabilities(air);
  observation.weather = decide_weather(observation.weather_probability);
  if (const auto mor = observation.mor_m()) observation.wmo_4680 = wmo_4680_now(observation.weather, *mor);
}

// Where the air is clear a dark target must be dark.
bool looks_like_snow(const DayView& view, const Site& site, double sigma, const DayOptions& options) {
  int near = 0, bright = 0;
  for (size_t i = 0; i < site.targets.size(); ++i) {
    const Target& target = site.targets[i];
    if (!target.distance_m || !view.targets[i].brightness_ratio || sigma * *target.distance_m > 0.3) continue;
    ++near;
    bright += *view.targets[i].brightness_ratio > options.snow_ratio;
  }
  return near > 0 && 2 * bright > near;
}

// Haze takes the same part of both halves' brightness, so what they differ by is light.
bool halves_differ(const TargetView& seen, const Target& target, double sigma, const DayOptions& options) {
  if (!seen.halves || !target.clear || !target.distance_m) return false;
  const double transmission = std::exp(-sigma * *target.distance_m);
  if (transmission < options.least_transmission) return false;
  const double change = std::abs(*seen.halves / transmission - target.clear->halves);
  return change > options.shadow_step && change > options.shadow_z * seen.halves_sigma / transmission;
}

bool has_shadows(const DayView& view, const Site& site, const ContrastFit& fit, double sigma,
                 const DayOptions& options) {
  // The lighting factors have unit spread over the time of learning: far outside is light never seen then.
  if (std::abs(fit.lighting[0]) > 3 || std::abs(fit.lighting[1]) > 3) return true;
  for (size_t i = 0; i < site.targets.size(); ++i)
    if (halves_differ(view.targets[i], site.targets[i], sigma, options)) return true;
  return false;
}

void flag_scene(const DayView& view, const Site& site, const ContrastFit& fit, bool odd,
                const DayOptions& options, Observation& observation) {
  // Drops make halves differ too.
  if (!observation.quality.has(Quality::rain_on_window) &&
      (odd || has_shadows(view, site, fit, *observation.extinction_per_m, options)))
    observation.quality.set(Quality::shadows);
  if (looks_like_snow(view, site, *observation.extinction_per_m, options))
    observation.quality.set(Quality::snow);
}

void doubt_wet_targets(const std::vector<TargetWindow>& window, const DayOptions& options, DayView& view) {
  for (size_t t = 0; t < view.targets.size(); ++t) {
    const bool clear = window[t].strips > 0 && window[t].weaker == 0;
    double& sigma = view.targets[t].brightness_ratio_sigma;
    sigma = std::hypot(sigma, clear ? options.clear_ratio_sigma : options.drops_ratio_sigma);
  }
}

double learned_error(const DayOptions& options, QualityFlags flags) {
  return std::hypot(flags.has(Quality::rain_on_window) ? options.drops_ln_sigma : 0,
                    flags.has(Quality::sun_in_picture) ? options.glare_ln_sigma : 0);
}

std::string obstacle(const photometry::RadianceImage& image, const Site& site, std::optional<SunPosition> sun,
                     bool monochrome, const DayOptions& options, QualityFlags& flags) {
  if (site.targets.empty()) {
    flags.set(Quality::no_targets);
    return "the site file lists no day targets ([[target]])";
  }
  if (image.empty()) return image.fault;
  if (!daylight_enough(image, sun, options)) return "it is night: no daylight on the targets";
  if (site.day && site.day->colour && monochrome) {
    flags.set(Quality::night_mode);
    return "the camera is in night mode; its targets were learned by day";
  }
  return {};
}

}  // namespace

bool daylight_enough(const photometry::RadianceImage& image, std::optional<SunPosition> sun,
                     const DayOptions& options) {
  if (sun) return sun->altitude_deg > options.least_altitude_deg;
  const int width = image.radiance.width_px, height = image.radiance.height_px;
  const auto sky = median_radiance(image, {0, 0, width, height / 3});
  return sky && *sky > options.least_sky * image.saturation_radiance;
}

void flag_sun(const photometry::RadianceImage& image, std::optional<SunPosition> sun,
              const DayOptions& options, Observation& observation) {
  if (sun && sun->altitude_deg < options.low_sun_deg) observation.quality.set(Quality::low_sun);
  if (saturated_part(image) > options.saturated_part) observation.quality.set(Quality::sun_in_picture);
}

void flag_window(const photometry::RadianceImage& image, const Site& site, Observation& observation) {
  if (rain_on_window(view_window(column_profiles(image, site.targets), site.targets)))
    observation.quality.set(Quality::rain_on_window);
}

void widen_for_scene(const DayOptions& options, Observation& observation) {
  const double error = 1.96 * learned_error(options, observation.quality);
  if (error <= 0 || observation.limit != Limit::none) return;
  const double ln = std::log(*observation.extinction_per_m);
  const auto widen = [&](std::optional<double>& bound, double sign) {
    if (bound) bound = std::exp(ln + sign * std::hypot(ln - std::log(*bound), error));
  };
  widen(observation.extinction_low_per_m, -1);
  widen(observation.extinction_high_per_m, +1);
}

std::vector<PosteriorPoint> widened(const std::vector<PosteriorPoint>& posterior, double ln_sigma_error) {
  if (posterior.size() < 2 || ln_sigma_error <= 0) return posterior;
  double least = posterior[0].minus_ln_probability;
  for (const PosteriorPoint& p : posterior) least = std::min(least, p.minus_ln_probability);
  std::vector<PosteriorPoint> result = posterior;
  for (PosteriorPoint& to : result) {
    double sum = 0, kernel = 0;
    for (const PosteriorPoint& from : posterior) {
      const double z = (to.ln_sigma - from.ln_sigma) / ln_sigma_error, k = std::exp(-0.5 * z * z);
      sum += k * std::exp(least - from.minus_ln_probability);
      kernel += k;  // at the ends the part of the kernel that is there counts for all of it
    }
    to.minus_ln_probability = -std::log(std::max(sum / kernel, 1e-300));
  }
  return result;
}

void measure_day(const photometry::RadianceImage& image, const Site& site, std::optional<SunPosition> sun,
                 bool monochrome, std::optional<double> relative_humidity, const DayOptions& options,
                 FrameResult& result) {
  Observation& observation = result.observation;
  result.reason = obstacle(image, site, sun, monochrome, options, observation.quality);
  if (!result.reason.empty()) return;
  DayView view = view_targets(image, site.targets, site.day);
  flag_sun(image, sun, options, observation);
  const std::vector<TargetWindow> window = view_window(column_profiles(image, site.targets), site.targets);
  if (rain_on_window(window)) {
    observation.quality.set(Quality::rain_on_window);
    doubt_wet_targets(window, options, view);
  }
  const SceneFit scene = fit_scene(view, site, options, observation.quality);
  const ContrastFit& fit = scene.fit;
  if (fit.posterior.empty()) {
    observation.quality.set(Quality::unknown_distance);
    result.reason = "no day target has both a known distance and a clear view of the sky above it";
    return;
  }
  const bool learned = fit.brightness_targets == 0;
  const std::vector<PosteriorPoint> posterior =
      widened(fit.posterior, learned ? std::hypot(site.day ? site.day->log_extinction_sigma : 0.0,
                                                  learned_error(options, observation.quality))
                                     : 0.0);
  BoundsOptions bounds_options;
  if (!learned) bounds_options.inflate = options.inflate;
  bounds_options.widest_ratio = learned ? options.widest_ratio_learned : options.widest_ratio;
  SigmaBounds bounds = sigma_bounds(posterior, bounds_options);
  double mode = refined_mode(posterior);
  if (bounds.limit == Limit::below && kMorTimesExtinction / bounds.value <= options.dense_fog_mor_m) {
    bounds = dense_fog(posterior);
    mode = std::log(bounds.value);
  }
  fill_bounds(bounds, mode, observation);
  observation.method = Method::contrast;
  observation.lights_used = fit.brightness_targets + fit.contrast_targets;
  if (learned) observation.quality.set(Quality::calibrated_distance);
  if (scene.snow) observation.quality.set(Quality::snow);
  flag_scene(view, site, fit, scene.odd, options, observation);
  fill_weather(bounds, relative_humidity, observation);
}

}  // namespace lampglow::inference
