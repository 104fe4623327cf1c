#include "estimator/estimate.h"

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

// Where lamps can't be measured, what `calibrate` learned of the night's patches, in the dark.
bool measured_by_patches(const Bracket& bracket, const photometry::RadianceImage& image, const Site& site,
                         const EstimatorOptions& options, FrameResult& result) {
  constexpr double kDark_deg = -6;
  if (!site.night || image.empty()) return false;
  if (site.latitude_deg && site.longitude_deg &&
      inference::sun_position(bracket.time_utc, *site.latitude_deg, *site.longitude_deg).altitude_deg >
          kDark_deg)
    return false;
  inference::measure_patches(image, site.camera, *site.night, options.relative_humidity, options.patches,
                             result);
  return true;
}

}  // namespace

std::optional<ClearReference> learn_reference(std::span<const Bracket> clear, const Site& site,
                                              const EstimatorOptions& options) {
  std::vector<inference::ClearFrame> frames;
  std::vector<photometry::CatalogueLamp> catalogue = photometry::catalogue_of(site);
  if (catalogue.empty()) return std::nullopt;
  for (const Bracket& bracket : clear) {
    photometry::RadianceImage image = photometry::to_radiance(bracket, site.camera, options.radiance);
    if (image.empty()) continue;
    auto registered = photometry::register_frame(image, catalogue, options.registration);
    frames.push_back({std::move(image), std::move(registered), bracket.time_utc, bracket.reference_mor_m});
  }
  if (frames.empty()) return std::nullopt;
  std::vector<photometry::RegisteredFrame> registered;
  for (const auto& frame : frames) registered.push_back(frame.registered);
  catalogue =
      photometry::refine_catalogue(catalogue, registered, site.camera.width_px, site.camera.height_px);
  for (auto& frame : frames)
    frame.registered = photometry::register_frame(frame.image, catalogue, options.registration);
  return inference::learn_clear_reference(frames, site, catalogue, *inference::halo_model(options.model),
                                          options.reference);
}

FrameResult estimate(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     const EstimatorOptions& options) {
  FrameResult result;
  Observation& observation = result.observation;
  observation.time_utc = bracket.time_utc;
  observation.quality = bracket.quality;
  result.reason = obstacle(bracket, site, reference, observation.quality);
  if (!result.reason.empty() && !site.night) return result;
  try {
    const photometry::RadianceImage image = photometry::to_radiance(bracket, site.camera, options.radiance);
    if (!result.reason.empty()) {
      measured_by_patches(bracket, image, site, options, result);
      return result;
    }
    observation.quality.set(image.quality);
    result.reason = image.empty() ? image.fault : std::string();
    if (image.empty()) return result;
    const photometry::RegisteredFrame registered =
        photometry::register_frame(image, reference->catalogue, options.registration);
    result.shift_x_px = registered.shift_x_px;
    result.shift_y_px = registered.shift_y_px;
    result.rotation_rad = registered.rotation_rad;
    inference::measure_night(image, registered, site, *reference, *inference::halo_model(options.model),
                             options.relative_humidity, options.night, result);
  } catch (const std::exception& error) {
    observation.quality.set(Quality::internal_error);
    result.reason = std::string("internal error: ") + error.what();
  }
  return result;
}

}  // namespace lampglow
