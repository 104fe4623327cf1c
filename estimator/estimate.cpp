#include "estimator/estimate.h"

#include <cmath>
#include <exception>

#include "estimator/inference/sun.h"

namespace lampglow {
namespace {

// Why this frame cannot be measured by its lamps; empty if it can.
std::string obstacle(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     QualityFlags& flags) {
  if (site.lights.empty()) flags.set(Quality::no_lights);
  if (!reference) flags.set(Quality::no_reference);
  if (!site.camera.focal_length_px) flags.set(Quality::no_angular_scale);
  if (bracket.exposures.empty()) return bracket.fault.empty() ? "no exposure could be read" : bracket.fault;
  if (site.lights.empty()) return "the site file lists no lamps ([[light]])";
  bool any_distance = false;
  for (const Light& light : site.lights) any_distance = any_distance || light.distance_m;
  if (!any_distance) {
    flags.set(Quality::unknown_distance);
    return "no lamp of the catalogue has a known distance";
  }
  if (!reference) return "no clear reference shows the catalogue's lamps";
  return {};
}

std::optional<inference::SunPosition> sun_at(const Bracket& bracket, const Site& site) {
  if (!site.latitude_deg || !site.longitude_deg) return std::nullopt;
  return inference::sun_position(bracket.time_utc, *site.latitude_deg, *site.longitude_deg);
}

std::optional<double> altitude_of(const std::optional<inference::SunPosition>& sun) {
  return sun ? std::optional(sun->altitude_deg) : std::nullopt;
}

bool is_monochrome(const Bracket& bracket) {
  for (const Exposure& exposure : bracket.exposures)
    if (!exposure.monochrome) return false;
  return true;
}

// Where lamps can't be measured, what `calibrate` learned of the night's patches, in the dark.
void measure_night_patches(const Bracket& bracket, const photometry::RadianceImage& image, const Site& site,
                           const EstimatorOptions& options, FrameResult& result) {
  if (!site.night || image.empty()) return;
  if (!inference::for_night_patches(altitude_of(sun_at(bracket, site)), is_monochrome(bracket), site))
    result.reason = "twilight: too light for what [night] was learned from, too dark for day targets";
  else
    inference::measure_patches(image, site.camera, *site.night, options.relative_humidity, Method::glow,
                               options.patches, result);
}

// The day's part: what `calibrate` learned of the day's patches where that foretells better than targets do,
// else the targets.
void estimate_day(const Bracket& bracket, const photometry::RadianceImage& image, const Site& site,
                  const EstimatorOptions& options, FrameResult& day) {
  const auto sun = sun_at(bracket, site);
  const bool monochrome = is_monochrome(bracket);
  day.observation.time_utc = bracket.time_utc;
  if (!image.empty() && inference::for_day_patches(altitude_of(sun), monochrome, site)) {
    inference::measure_patches(image, site.camera, *site.day_patches, options.relative_humidity,
                               Method::contrast, options.patches, day);
    inference::flag_sun(image, sun, options.day, day.observation);
    inference::flag_window(image, site, day.observation);
    if (day.observation.extinction_per_m) {
      inference::widen_for_scene(options.day, day.observation);
      return;
    }
  }
  inference::measure_day(image, site, sun, monochrome, options.relative_humidity, options.day, day);
}

// The lamps' part: registration, and the joint fit of their halos.
void estimate_night(const Bracket& bracket, const photometry::RadianceImage& image, const Site& site,
                    const std::optional<ClearReference>& reference, const EstimatorOptions& options,
                    FrameResult& result) {
  result.reason = obstacle(bracket, site, reference, result.observation.quality);
  if (!result.reason.empty()) {
    measure_night_patches(bracket, image, site, options, result);
    return;
  }
  if (image.empty()) result.reason = image.fault;
  if (image.empty()) return;
  const photometry::RegisteredFrame registered =
      photometry::register_frame(image, reference->catalogue, options.registration);
  result.shift_x_px = registered.shift_x_px;
  result.shift_y_px = registered.shift_y_px;
  result.rotation_rad = registered.rotation_rad;
  if (std::hypot(registered.shift_x_px, registered.shift_y_px) > options.moved_px)
    result.observation.quality.set(Quality::camera_moved);
  inference::stop_if_given_up(options.night.fit);
  inference::measure_night(image, registered, site, *reference, *inference::halo_model(options.model),
                           options.relative_humidity, options.night, result);
}

// The sensor's hot pixels that the reference knows are masked, whether they stand out in this frame or not.
photometry::RadianceImage radiance_of(const Bracket& bracket, const Site& site,
                                      const std::optional<ClearReference>& reference,
                                      const EstimatorOptions& options) {
  photometry::RadianceOptions radiance = options.radiance;
  if (reference)
    radiance.hot_pixels.insert(radiance.hot_pixels.end(), reference->hot_pixels.begin(),
                               reference->hot_pixels.end());
  return photometry::to_radiance(bracket, site.camera, radiance);
}

// Takes the day's part into the frame's result.
void merge_day(const FrameResult& day, std::optional<double> altitude_deg, const EstimatorOptions& options,
               FrameResult& result) {
  const bool day_only =
      !result.observation.extinction_per_m && inference::contrast_weight(altitude_deg, options.combine) > 0.5;
  result.observation = inference::combine(result.observation, day.observation, altitude_deg, options.combine);
  if (result.observation.extinction_per_m)
    result.reason.clear();
  else if (day_only || result.reason.empty())
    result.reason = day.reason;
}

bool is_dark(const photometry::RadianceImage& image) {
  constexpr double kDark = 0.1;  // of the shortest exposure's range; daylight skies are exposed well above it
  if (image.empty()) return false;
  const auto sky =
      inference::median_radiance(image, {0, 0, image.radiance.width_px, image.radiance.height_px / 3});
  return sky && *sky < kDark * image.saturation_radiance;
}

void flag_light(const std::optional<inference::SunPosition>& sun, const EstimatorOptions& options,
                Observation& observation) {
  if (!sun) return;
  if (inference::glow_weight(sun->altitude_deg, options.combine) <= 0)
    observation.quality.set(Quality::daylight);
  else if (sun->altitude_deg > -6)
    observation.quality.set(Quality::twilight);
}

}  // namespace

FrameResult estimate(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     const EstimatorOptions& options) {
  FrameResult result;
  result.observation.time_utc = bracket.time_utc;
  result.observation.quality = bracket.quality;
  try {
    inference::stop_if_given_up(options.night.fit);
    const photometry::RadianceImage image = radiance_of(bracket, site, reference, options);
    result.observation.quality.set(image.quality);
    inference::stop_if_given_up(options.night.fit);
    const std::optional<inference::SunPosition> sun = sun_at(bracket, site);
    // In daylight lamps are off or drowned; in the dark there is no contrast to see.
    // A dark picture of lamps is believed against the clock where the site has nothing else to go by.
    const bool lamps = inference::glow_weight(altitude_of(sun), options.combine) > 0 ||
                       (reference && site.targets.empty() && is_dark(image));
    const bool patches = inference::for_day_patches(altitude_of(sun), is_monochrome(bracket), site);
    const bool targets = patches || (inference::contrast_weight(altitude_of(sun), options.combine) > 0 &&
                                     !(lamps && site.targets.empty()));
    if (lamps) estimate_night(bracket, image, site, reference, options, result);
    if (targets) {
      FrameResult day;
      estimate_day(bracket, image, site, options, day);
      merge_day(day, altitude_of(sun), options, result);
    }
    flag_light(sun, options, result.observation);
  } catch (const std::exception& error) {
    result.observation.quality.set(Quality::internal_error);
    result.reason = std::string("internal error: ") + error.what();
  }
  return result;
}

}  // namespace lampglow
