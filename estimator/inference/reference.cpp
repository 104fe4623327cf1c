#include "estimator/inference/reference.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/observation.h"
#include "estimator/photometry/median.h"

namespace lampglow::inference {
namespace {

constexpr std::uint8_t kForeign = 64;  // our own mask bit, beside photometry's
constexpr double kWide_rad = 9.0 * std::numbers::pi / 180;
constexpr double kUsualFocalLength_px = 1044;
constexpr double kCoreRadiusPerWidth = 1.9;  // core radius over the lens' full width at half maximum

double median_of(std::vector<double> values) {
  return values.empty() ? 0 : photometry::median_of(values);
}

void mask_disc(Image<std::uint8_t>& mask, double x, double y, double radius) {
  for (int row = static_cast<int>(y - radius); row <= static_cast<int>(y + radius); ++row)
    for (int column = static_cast<int>(x - radius); column <= static_cast<int>(x + radius); ++column)
      if (mask.contains(column, row) && std::hypot(column + 0.5 - x, row + 0.5 - y) <= radius)
        mask.at(column, row) |= kForeign;
}

// Lights that shine in the clear reference but are in no catalogue: part of the scene, at unknown distance.
std::vector<photometry::CatalogueLamp> with_strays(std::span<const photometry::CatalogueLamp> catalogue,
                                                   const photometry::RegisteredFrame& registered,
                                                   const ReferenceOptions& options) {
  std::vector<photometry::CatalogueLamp> all(catalogue.begin(), catalogue.end());
  std::vector<double> fluxes;
  for (const auto& lamp : registered.lamps) fluxes.push_back(lamp.core_flux);
  const double least = options.stray_min_part * median_of(fluxes);
  int number = 0;
  for (const auto& stray : registered.strays) {
    if (number >= options.max_strays || stray.flux < least || stray.snr < 12) continue;
    photometry::CatalogueLamp lamp;
    lamp.id = "stray-" + std::to_string(++number);
    lamp.x_px = stray.x_px;
    lamp.y_px = stray.y_px;
    lamp.core_flux = stray.flux;
    all.push_back(lamp);
  }
  return all;
}

// Median width of the unsaturated lamps' own cores.
double usual_width_px(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered) {
  std::vector<double> widths;
  for (const auto& lamp : registered.lamps) {
    if (lamp.state != LampState::seen) continue;
    const auto light = photometry::measure_light(image, lamp.x_px, lamp.y_px);
    if (light.saturated_pixels == 0 && light.fwhm_px > 0) widths.push_back(light.fwhm_px);
  }
  return std::min(median_of(std::move(widths)), 8.0);
}

const Light* light_of(const Site& site, const std::string& id) {
  for (const Light& light : site.lights)
    if (light.id == id) return &light;
  return nullptr;
}

std::vector<SceneLamp> scene_lamps(const Site& site, std::span<const photometry::CatalogueLamp> catalogue,
                                   const ReferenceOptions& options) {
  std::vector<SceneLamp> lamps;
  for (const auto& entry : catalogue) {
    SceneLamp lamp;
    lamp.id = entry.id;
    lamp.x_px = entry.x_px;
    lamp.y_px = entry.y_px;
    lamp.distance_m = options.stray_distance_m;
    lamp.distance_ln_sigma = options.stray_distance_ln_sigma;
    const Light* light = light_of(site, entry.id);
    lamp.catalogued = light != nullptr;
    if (light && light->distance_m) {
      lamp.distance_m = light->distance_m;
      lamp.distance_ln_sigma = light->distance_sigma_m.value_or(0.0) / *light->distance_m;
    }
    lamps.push_back(lamp);
  }
  return lamps;
}

// Exposures that are not told differ from frame to frame: each to the first one's brightness, by the median
// ratio of their rings. A ring that only some frames have would else stand out from its neighbours.
void equalise(std::vector<RingData>& frames) {
  const RingData& first = frames.front();
  for (size_t f = 1; f < frames.size(); ++f) {
    RingData& frame = frames[f];
    std::vector<double> ratios;
    for (size_t r = 0; r < frame.value.size(); ++r)
      if (frame.used[r] && first.used[r] && frame.value[r] > 0 && first.value[r] > 0)
        ratios.push_back(first.value[r] / frame.value[r]);
    if (ratios.empty()) continue;
    const double ratio = median_of(std::move(ratios));
    for (double& value : frame.value) value *= ratio;
    for (double& sigma : frame.sigma) sigma *= ratio;
    for (double& noise : frame.noise) noise *= ratio;
    frame.sky_unit *= ratio;
  }
}

// Weighted means of the rings over the clear frames.
RingData average(const std::vector<RingData>& frames) {
  RingData mean = frames.front();
  for (size_t r = 0; r < mean.value.size(); ++r) {
    double sum = 0, weight = 0, worst = 0, noise = 0;
    for (const RingData& frame : frames) {
      if (!frame.used[r]) continue;
      const double w = 1 / (frame.sigma[r] * frame.sigma[r]);
      sum += w * frame.value[r];
      weight += w;
      noise += std::pow(w * frame.noise[r], 2);
      worst = std::max(worst, frame.sigma[r]);
    }
    mean.used[r] = weight > 0;
    if (weight <= 0) continue;
    mean.value[r] = sum / weight;
    mean.noise[r] = std::sqrt(noise) / weight;
    mean.sigma[r] = worst;  // mostly model error, which averaging does not lessen
  }
  return mean;
}

std::vector<photometry::RingCentre> centres_of(std::span<const photometry::CatalogueLamp> lamps) {
  std::vector<double> fluxes;
  for (const auto& lamp : lamps) fluxes.push_back(lamp.core_flux.value_or(0));
  const double usual = std::max(median_of(fluxes), 1e-9);
  std::vector<photometry::RingCentre> centres;
  for (const auto& lamp : lamps)
    centres.push_back({lamp.x_px, lamp.y_px, std::clamp(lamp.core_flux.value_or(usual) / usual, 1e-3, 1e3)});
  return centres;
}

// How much the lamp's light varied between the clear frames, as seen in its core.
double scatter_of(std::span<const ClearFrame> frames, size_t lamp) {
  std::vector<double> ln_flux;
  for (const ClearFrame& frame : frames)
    if (lamp < frame.registered.lamps.size() && frame.registered.lamps[lamp].core_flux > 0)
      ln_flux.push_back(std::log(frame.registered.lamps[lamp].core_flux));
  if (ln_flux.size() < 3) return 0;
  double mean = 0, square = 0;
  for (const double x : ln_flux) mean += x / static_cast<double>(ln_flux.size());
  for (const double x : ln_flux) square += (x - mean) * (x - mean) / static_cast<double>(ln_flux.size() - 1);
  return std::sqrt(square);
}

// What each ring shows over the smooth model, as far as it stands out of the picture's noise, and within what
// a lens or a roof may do. It is the lens' where the lamp outshines the sky, and the sky's where not.
Scene::RingPattern pattern_of(const RingData& data, const LearnedSpread& learned) {
  constexpr double kMost = 0.3;
  const size_t rings = data.value.size(), per_lamp = rings / std::max<size_t>(learned.sky.size(), 1);
  Scene::RingPattern pattern{std::vector<double>(rings, 0.0), std::vector<double>(rings, 0.0)};
  for (size_t r = 0; r < rings; ++r) {
    const double model = learned.model[r];
    if (!data.used[r] || model <= 0) continue;
    const double off = data.value[r] / model - 1, noise = data.noise[r] / model;
    const double shown = off * off * off / (off * off + noise * noise + 1e-12);
    const double sky = std::clamp(learned.sky[r / per_lamp] / model, 0.0, 1.0), light = 1 - sky;
    const double whole = light * light + sky * sky;
    pattern.lens[r] = std::clamp(shown * light / whole, -kMost, kMost);
    pattern.sky[r] = std::clamp(shown * sky / whole, -kMost, kMost);
  }
  return pattern;
}

}  // namespace

double foreign_radius_px(const photometry::DetectedLight& light) {
  const double glare = std::sqrt(std::max(0.0, 0.01 * light.flux / std::max(light.background, 1e-12)) / 3.0);
  return std::clamp(6.0 + glare + std::sqrt(static_cast<double>(light.saturated_pixels)), 6.0, 60.0);
}

RingData ring_data(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                   const photometry::RingMap& map, std::span<const photometry::DetectedLight> foreign,
                   const RingErrors& errors) {
  Image<std::uint8_t> mask = image.mask;
  for (const auto& light : foreign) mask_disc(mask, light.x_px, light.y_px, foreign_radius_px(light));
  const photometry::FrameView view{
      image.radiance,
      image.variance,
      mask,
      static_cast<std::uint8_t>(photometry::kHot | photometry::kInvalid | kForeign),
      static_cast<std::uint8_t>(photometry::kSaturated | photometry::kBloom),
      registered.shift_x_px,
      registered.shift_y_px,
      registered.rotation_rad};
  const auto means = photometry::measure_rings(view, map);
  RingData data;
  const auto per_lamp = static_cast<size_t>(map.options.rings);
  std::vector<double> skies;
  for (size_t first = 0; first < means.size(); first += per_lamp) {
    double sky = 0;
    bool found = false;
    for (size_t k = 0; k < per_lamp; ++k) {
      const auto& ring = means[first + k];
      if (ring.pixels == 0) continue;
      sky = found ? std::min(sky, ring.mean) : ring.mean;
      found = true;
    }
    if (found) skies.push_back(sky);
    for (size_t k = 0; k < per_lamp; ++k) {
      const auto& ring = means[first + k];
      const bool steep = k > 0 && map.edges_rad[k] < 1.5 * map.edges_rad[1];
      const bool doubtful_core = k == 0 && image.relative;
      const double wide = std::pow(map.rings[first + k].theta_mean_rad / kWide_rad, 2);
      const double smooth = image.compressed_colour ? errors.of_coloured_sky : errors.of_sky;
      const double of_sky = std::hypot(smooth, image.relative ? 0.0 : errors.of_wide_sky * wide);
      const double of_light = steep ? errors.steep : doubtful_core ? errors.relative_core : errors.of_light;
      data.value.push_back(ring.mean);
      data.used.push_back(ring.pixels > 0 && std::isfinite(ring.variance));
      data.noise.push_back(std::sqrt(std::max(ring.variance, 0.0)));
      data.sigma.push_back(std::sqrt(std::pow(data.noise.back(), 2) +
                                     std::pow(of_light * (ring.mean - sky), 2) +
                                     std::pow(of_sky * ring.mean, 2) + 1e-24));
    }
  }
  data.sky_unit = std::max(median_of(skies), 1e-9);
  data.lit.assign(map.centres.size(), 1);
  return data;
}

ReferenceLayout lay_out(const photometry::RadianceImage& first, const photometry::RegisteredFrame& registered,
                        const Site& site, std::span<const photometry::CatalogueLamp> catalogue,
                        const ReferenceOptions& options) {
  ReferenceLayout layout;
  layout.options = options;
  const photometry::AngularScale scale(site.camera);
  layout.options.rings.core_radius_px =
      std::max(options.rings.core_radius_px * scale.focal_length_px / kUsualFocalLength_px,
               kCoreRadiusPerWidth * usual_width_px(first, registered));
  layout.catalogue = with_strays(catalogue, registered, options);
  layout.rings = std::make_shared<const photometry::RingMap>(
      photometry::make_ring_map(site.camera, centres_of(layout.catalogue), layout.options.rings));
  return layout;
}

RingData clear_rings(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                     const ReferenceLayout& layout) {
  return ring_data(image, registered, *layout.rings, {}, {.of_light = layout.options.spread.ring_error});
}

std::optional<ClearReference> learn_clear_reference(std::span<const ClearFrame> frames,
                                                    const ReferenceLayout& layout, const Site& site,
                                                    const HaloModel& halo) {
  if (frames.empty()) return std::nullopt;
  const bool any_seen = std::any_of(
      frames.front().registered.lamps.begin(), frames.front().registered.lamps.end(),
      [](const auto& lamp) { return lamp.state == LampState::seen || lamp.state == LampState::saturated; });
  if (!any_seen) return std::nullopt;
  const ReferenceOptions& options = layout.options;
  ClearReference reference;
  reference.catalogue = layout.catalogue;
  reference.rings = layout.rings;
  std::vector<RingData> rings;
  double extinction = 0;
  int known = 0;
  for (const ClearFrame& frame : frames) {
    rings.push_back(frame.rings);
    reference.learned_utc = std::max(reference.learned_utc, frame.time_utc);
    if (frame.mor_m) extinction += kMorTimesExtinction / *frame.mor_m, ++known;
  }
  const double assumed = kMorTimesExtinction / options.spread.clear_mor_m;
  extinction = known > 0 ? extinction / known : assumed;
  if (known > 0) reference.mor_m = kMorTimesExtinction / extinction;
  const double extinction_ln_sigma = known > 0 ? 0.1 : options.clear_mor_ln_sigma;

  std::vector<SceneLamp> lamps = scene_lamps(site, reference.catalogue, options);
  if (frames.front().relative) equalise(rings);
  const RingData mean = average(rings);
  const LearnedSpread learned =
      learn_spread(site.camera, *reference.rings, lamps, halo, mean, extinction, options.spread);
  for (size_t j = 0; j < lamps.size(); ++j) {
    const double usual = std::max(options.lamp_rel_sigma, scatter_of(frames, j));
    const double clear_thickness = extinction * lamps[j].distance_m.value_or(options.stray_distance_m);
    lamps[j].ln_strength = learned.ln_strength[j];
    lamps[j].core_seen = mean.used[j * static_cast<size_t>(options.rings.rings)] != 0;
    lamps[j].ln_strength_sigma =
        std::hypot(usual, std::min(learned.ln_strength_sigma[j], 1.0), clear_thickness * extinction_ln_sigma);
    reference.lamps.push_back({lamps[j].id, lamps[j].x_px, lamps[j].y_px, std::exp(lamps[j].ln_strength),
                               lamps[j].ln_strength_sigma, lamps[j].catalogued});
  }
  reference.frames = static_cast<int>(frames.size());
  reference.relative = frames.front().relative;
  reference.core_seen = learned.core_seen;
  reference.sky = median_of(learned.sky);
  reference.chi2_per_ring = learned.chi2_per_ring;
  reference.spread = learned.spread;
  auto scene = std::make_shared<Scene>(site.camera, lamps, learned.spread, *reference.rings);
  // Saturated cores leave the spread too loosely known to tell a pattern from it.
  if (!reference.relative) scene->set_pattern(pattern_of(mean, learned));
  reference.scene = std::move(scene);
  return reference;
}

}  // namespace lampglow::inference
