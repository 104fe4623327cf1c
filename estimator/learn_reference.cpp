#include "estimator/learn_reference.h"

#include <utility>
#include <vector>

#include "estimator/inference/day_reference.h"
#include "estimator/inference/sun.h"
#include "estimator/photometry/targets.h"

namespace lampglow {
namespace {

std::optional<double> sun_altitude_deg(TimePoint time_utc, const Site& site) {
  if (!site.latitude_deg || !site.longitude_deg) return std::nullopt;
  return inference::sun_position(time_utc, *site.latitude_deg, *site.longitude_deg).altitude_deg;
}

// Lamps are no yardstick in daylight where there are targets.
bool for_targets(TimePoint time_utc, const Site& site, const EstimatorOptions& options) {
  const auto altitude = sun_altitude_deg(time_utc, site);
  return altitude && *altitude > options.combine.glow_full_deg && !site.targets.empty();
}

// One bracket, ready to be measured, and when it was taken. Many of them, or large ones, take long: each step
// asks first whether the answer is still wanted.
struct Clear {
  TimePoint time_utc{};
  std::optional<double> mor_m;
  photometry::RadianceImage image;
};

Clear read(const ClearBrackets& clear, std::size_t i, const Site& site, const EstimatorOptions& options) {
  inference::stop_if_given_up(options.night.fit);
  const Bracket bracket = clear.load(i);
  inference::stop_if_given_up(options.night.fit);
  Clear read{bracket.time_utc, bracket.reference_mor_m,
             photometry::to_radiance(bracket, site.camera, options.radiance)};
  inference::stop_if_given_up(options.night.fit);
  return read;
}

// What a first look at all brackets gives: where the lamps are, and where the sky ends.
struct FirstLook {
  std::vector<std::size_t> usable;  // brackets that count for lamps
  std::vector<photometry::CatalogueLamp> catalogue;
  std::vector<int> skyline_px;  // from the daylight brackets; empty without any
};

FirstLook look(const ClearBrackets& clear, const Site& site, const EstimatorOptions& options) {
  FirstLook first;
  const std::vector<photometry::CatalogueLamp> given = photometry::catalogue_of(site);
  std::vector<photometry::RegisteredFrame> registered;
  std::vector<photometry::RadianceImage> daylight;
  for (std::size_t i = 0; i < clear.count; ++i) {
    auto [time_utc, mor_m, image] = read(clear, i, site, options);
    if (image.empty()) continue;
    if (for_targets(time_utc, site, options)) {
      daylight.push_back(std::move(image));
      continue;
    }
    registered.push_back(photometry::register_frame(image, given, options.registration));
    first.usable.push_back(i);
  }
  first.catalogue =
      photometry::refine_catalogue(given, registered, site.camera.width_px, site.camera.height_px);
  if (!daylight.empty()) first.skyline_px = photometry::survey_day(daylight).skyline_px;
  return first;
}

}  // namespace

std::optional<ClearReference> learn_reference(const ClearBrackets& clear, const Site& site,
                                              const EstimatorOptions& options) {
  if (site.lights.empty()) return std::nullopt;
  const FirstLook first = look(clear, site, options);
  inference::ReferenceOptions reference_options = options.reference;
  reference_options.rings.skyline_px = first.skyline_px;
  reference_options.spread.given_up = options.night.fit.given_up;
  std::optional<inference::ReferenceLayout> layout;
  std::vector<inference::ClearFrame> frames;
  photometry::HotPixelLearner hot;
  for (const std::size_t i : first.usable) {
    const auto [time_utc, mor_m, image] = read(clear, i, site, options);
    if (image.empty()) continue;  // gone since the first look, or the run is to stop
    auto registered = photometry::register_frame(image, first.catalogue, options.registration);
    if (!layout) layout = inference::lay_out(image, registered, site, first.catalogue, reference_options);
    frames.push_back({inference::clear_rings(image, registered, *layout), std::move(registered),
                      image.relative, time_utc, mor_m});
    hot.add(image.hot_pixels);
  }
  if (!layout) return std::nullopt;
  auto reference =
      inference::learn_clear_reference(frames, *layout, site, *inference::halo_model(options.model));
  if (reference) reference->hot_pixels = hot.map();
  return reference;
}

void learn_targets(const ClearBrackets& clear, Site& site, const EstimatorOptions& options) {
  if (site.targets.empty()) return;
  inference::ClearTargetLearner learner(site);
  for (std::size_t i = 0; i < clear.count; ++i) {
    inference::stop_if_given_up(options.night.fit);
    const Bracket bracket = clear.load(i);
    const auto altitude = sun_altitude_deg(bracket.time_utc, site);
    if (!altitude || inference::contrast_weight(*altitude, options.combine) < 1) continue;
    const photometry::RadianceImage image = photometry::to_radiance(bracket, site.camera, options.radiance);
    if (!image.empty()) learner.add(image);
  }
}

}  // namespace lampglow
