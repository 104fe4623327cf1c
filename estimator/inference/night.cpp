#include "estimator/inference/night.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/inference/luminaire.h"
#include "estimator/inference/modes.h"
#include "estimator/inference/weather.h"

namespace lampglow::inference {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

bool shows(const photometry::LampSighting& lamp) {
  return lamp.state == LampState::seen || lamp.state == LampState::saturated;
}

// Flux that the core of lamp j should have in this frame by the fit, in units of its clear core flux.
double expected_core_ratio(const Scene& scene, std::span<const double> parameters, size_t j) {
  const Layout at(scene.lamps().size());
  const double thickness = std::exp(parameters[Layout::ln_sigma] + parameters[at.ln_distance(j)]) *
                           scene.lamps()[j].distance_m.value_or(1.0);
  return std::exp(parameters[Layout::ln_gain] - thickness);
}

struct Night {
  Scene scene;  // the reference's lamps, then the frame's guests
  RingData data;
  JointFit fit;
};

// Lights of this frame that the scene knows nothing of.
std::vector<photometry::DetectedLight> foreign_lights(const photometry::RegisteredFrame& registered) {
  std::vector<photometry::DetectedLight> foreign;
  for (const auto& light : registered.strays)
    if (light.snr > 8) foreign.push_back(light);
  return foreign;
}

// The brightest foreign lights as lamps of unknown distance: their halos are in the frame's rings.
std::vector<SceneLamp> guests_of(std::span<const photometry::DetectedLight> foreign,
                                 const photometry::RegisteredFrame& registered,
                                 const photometry::RadianceImage& image, const Site& site,
                                 const ClearReference& reference, const NightOptions& options) {
  const double x0 = image.radiance.width_px / 2.0, y0 = image.radiance.height_px / 2.0;
  const double c = std::cos(registered.rotation_rad), s = std::sin(registered.rotation_rad);
  std::vector<SceneLamp> guests;
  for (const auto& light : foreign) {
    if (static_cast<int>(guests.size()) >= options.max_guests) break;
    if (!(light.flux > 0)) continue;
    const double dx = light.x_px - registered.shift_x_px - x0, dy = light.y_px - registered.shift_y_px - y0;
    SceneLamp guest;
    guest.id = "guest";
    guest.x_px = x0 + c * dx + s * dy;
    guest.y_px = y0 - s * dx + c * dy;
    guest.distance_m = options.guest_distance_m;
    guest.distance_ln_sigma = options.guest_distance_ln_sigma;
    guest.ln_beam = std::log(light.flux / reference.spread.core_fraction);
    guest.ln_beam_sigma = light.saturated_pixels > 0 ? options.guest_saturated_ln_sigma
                                                     : std::hypot(0.2, light.flux_sigma / light.flux);
    guest.masked_rad = foreign_radius_px(light) / photometry::AngularScale(site.camera).focal_length_px;
    guest.ln_strength = *guest.ln_beam;
    guest.ln_strength_sigma = options.guest_strength_ln_sigma;
    guest.catalogued = false;
    guests.push_back(guest);
  }
  return guests;
}

// What the reference showed over its smooth sky need not be there in another air.
void doubt_pattern(const Scene& scene, const RingErrors& errors, RingData& data) {
  const std::vector<double>& sky = scene.pattern().sky;
  for (size_t r = 0; r < sky.size(); ++r)
    data.sigma[r] = std::hypot(data.sigma[r], errors.of_pattern * sky[r] * data.value[r]);
}

// Lamps without a core start as off. Those that the fit then says could not be seen anyway are lit: their
// halo counts.
Night fit_with_outages(const photometry::RegisteredFrame& registered, const ClearReference& reference,
                       const HaloModel& halo, const NightOptions& options, Scene with_guests, RingData data) {
  Night night{std::move(with_guests), {}, {}};
  const Scene& scene = night.scene;
  data.lit.resize(scene.lamps().size(), 1);
  const bool any = std::any_of(registered.lamps.begin(), registered.lamps.end(), shows);
  std::vector<char> doubtful(registered.lamps.size(), 0);
  for (size_t j = 0; j < doubtful.size() && any; ++j) {
    doubtful[j] =
        registered.lamps[j].state == LampState::off || registered.lamps[j].state == LampState::hidden;
    data.lit[j] = !doubtful[j];
  }
  Modes found;
  for (int round = 0; round < 4; ++round) {
    found = find_modes(scene, halo, data, options.fit);
    const Mode& best = found.modes.front();
    bool changed = false;
    for (size_t j = 0; j < doubtful.size(); ++j) {
      if (!doubtful[j] || data.lit[j]) continue;
      const double clear = reference.catalogue[j].core_flux.value_or(0);
      const double expected = clear * expected_core_ratio(scene, best.solved.parameters, j);
      if (expected > options.faint_sigma * registered.lamps[j].core_flux_sigma) continue;
      data.lit[j] = 1;
      changed = true;
    }
    if (!changed) break;
  }
  night.fit = complete(scene, halo, options.fit, std::move(found));
  night.data = std::move(data);
  return night;
}

// What the picture alone says of lamp j's halo, as it would be in fog: the prior is taken off the posterior
// again, so that a lesson from many frames is not pulled towards the prior as often as there are frames.
void describe_halo(const Scene& scene, const JointFit& fit, size_t j, LampFit& lamp) {
  constexpr double kTellsNothing = 1;  // of ln; a halo twice or half as strong
  const size_t at = Layout(scene.lamps().size()).ln_halo(j);
  const double posterior = fit.sigma[at], prior = scene.lamps()[j].ln_halo_sigma;
  if (!(posterior > 0) || posterior >= prior) return;
  const double information = 1 / (posterior * posterior) - 1 / (prior * prior);
  const double weight = luminaire_weight(fit.parameters[Layout::q]);
  if (!(weight > 0) || information * weight * weight < 1 / (kTellsNothing * kTellsNothing)) return;
  lamp.ln_halo = fit.parameters[at] / (posterior * posterior * information) / weight;
  lamp.ln_halo_sigma = 1 / std::sqrt(information) / weight;
}

void describe_lamps(const Night& night, const photometry::RegisteredFrame& registered, const Site& site,
                    const ClearReference& reference, FrameResult& result) {
  const Scene& scene = night.scene;
  const Layout at(scene.lamps().size());
  const auto per_lamp = static_cast<size_t>(reference.rings->options.rings);
  for (size_t j = 0; j < scene.lamps().size(); ++j) {
    if (!scene.lamps()[j].catalogued) continue;
    LampFit lamp;
    const auto& sighting = registered.lamps[j];
    lamp.id = scene.lamps()[j].id;
    lamp.state = night.data.lit[j] ? sighting.state : LampState::off;
    if (night.data.lit[j] && lamp.state == LampState::off) lamp.state = LampState::faded;
    lamp.x_px = sighting.x_px;
    lamp.y_px = sighting.y_px;
    for (const Light& light : site.lights)
      if (light.id == lamp.id) lamp.distance_m = light.distance_m;
    if (night.data.lit[j])
      lamp.strength_ratio =
          std::exp(night.fit.parameters[at.ln_strength(j)] + night.fit.parameters[Layout::ln_gain]);
    lamp.optical_thickness = std::exp(night.fit.ln_sigma() + night.fit.parameters[at.ln_distance(j)]) *
                             scene.lamps()[j].distance_m.value_or(1.0);
    if (night.data.lit[j]) describe_halo(scene, night.fit, j, lamp);
    double sum = 0;
    int count = 0;
    for (size_t k = 0; k < per_lamp; ++k) {
      const size_t r = j * per_lamp + k;
      if (!night.data.used[r]) continue;
      lamp.profile.theta_deg.push_back(reference.rings->rings[r].theta_mean_rad / kDegree);
      lamp.profile.radiance.push_back(night.data.value[r]);
      lamp.profile.radiance_sigma.push_back(night.data.sigma[r]);
      lamp.profile.model.push_back(night.fit.model[r]);
      sum += std::pow((night.fit.model[r] - night.data.value[r]) / night.data.sigma[r], 2);
      ++count;
    }
    if (count > 0) lamp.residual_rms = std::sqrt(sum / count);
    result.lamps.push_back(std::move(lamp));
  }
}

double excess_of_luminaires(double q, const NightOptions& options) {
  return options.luminaire_q_sigma * (1 - q) * (1 - q);
}

void fill_q(const JointFit& fit, const NightOptions& options, Observation& observation) {
  const double q = fit.parameters[Layout::q], sd = fit.sigma[Layout::q];
  if (sd <= 0 || sd > options.q_known_ratio * prior_q_sigma(fit.ln_sigma(), options.fit)) {
    observation.quality.set(Quality::q_unknown);
    return;
  }
  const double whole = std::hypot(sd, excess_of_luminaires(q, options));
  observation.q = q;
  observation.q_low = std::max(0.0, q - 1.96 * whole);
  observation.q_high = std::min(1.0, q + 1.96 * whole);
}

void fill_weather(const JointFit& fit, const SigmaBounds& bounds, const NightOptions& options,
                  std::optional<double> humidity, Observation& observation) {
  AirEstimate air;
  air.ln_sigma = bounds.limit == Limit::none ? fit.ln_sigma() : std::log(bounds.value);
  air.ln_sigma_sd = bounds.limit == Limit::none ? bounds.ln_sd : 0.05;
  if (bounds.limit == Limit::none) {  // a limit has no q: its best mode need not be the right one
    air.q = fit.parameters[Layout::q];
    air.q_sd = std::max(fit.sigma[Layout::q], 0.01);
    air.q_excess_of_luminaires = excess_of_luminaires(*air.q, options);
  }
  air.relative_humidity = humidity;
  air.limit = bounds.limit;
  observation.weather_probability = weather_probabilities(air);
  observation.weather = decide_weather(observation.weather_probability);
  if (observation.q) observation.lecture_class = lecture_class(*observation.q);
  if (const auto mor = observation.mor_m()) observation.wmo_4680 = wmo_4680_now(observation.weather, *mor);
  observation.relative_humidity = humidity;
}

void fill_flags(const Night& night, const photometry::RegisteredFrame& registered,
                const ClearReference& reference, const NightOptions& options, FrameResult& result) {
  QualityFlags& flags = result.observation.quality;
  const Scene& scene = *reference.scene;
  int known = 0, missing = 0;
  bool saturated = false, any_visible = false;
  for (size_t j = 0; j < scene.lamps().size(); ++j) {
    any_visible = any_visible || shows(registered.lamps[j]);
    if (!scene.lamps()[j].catalogued) continue;
    if (night.data.lit[j]) ++known;
    if (!night.data.lit[j]) ++missing;
    saturated = saturated || registered.lamps[j].saturated_pixels > 0;
  }
  result.observation.lights_used = known;
  if (known < options.few_lights) flags.set(Quality::few_lights);
  if (missing > 0) flags.set(Quality::lights_missing);
  if (saturated) flags.set(Quality::saturated);
  if (!any_visible) flags.set(Quality::no_lamp_visible);
  if (!registered.registered) flags.set(Quality::not_registered);
  if (!registered.strays.empty()) flags.set(Quality::stray_lights);
  if (options.fit.gain_known && std::abs(night.fit.parameters[Layout::ln_gain]) > options.gain_drift_ln)
    flags.set(Quality::gain_drift);
  if (!night.fit.converged) flags.set(Quality::fit_not_converged);
  if (night.fit.chi2_per_ring > options.poor_chi2) flags.set(Quality::poor_fit);
  if (night.scene.lamps().size() > scene.lamps().size()) flags.set(Quality::moving_lights);
  constexpr double kAtBound = 0.01;  // of ln σ
  if (night.fit.ln_sigma() > std::log(kMorTimesExtinction / options.fit.min_mor_m) - kAtBound ||
      night.fit.ln_sigma() < std::log(kMorTimesExtinction / options.fit.max_mor_m) + kAtBound)
    flags.set(Quality::at_bound);
}

}  // namespace

void measure_night(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                   const Site& site, const ClearReference& reference, const HaloModel& halo,
                   std::optional<double> relative_humidity, const NightOptions& given, FrameResult& result) {
  NightOptions options = given;
  options.fit.ln_half = options.ln_half;
  options.fit.gain_known = !image.relative && !reference.relative;
  if (image.relative || image.shortest_s == image.longest_s) {
    options.bounds.inflate = options.single_exposure_inflate;
    options.bounds.ln_floor = options.single_exposure_ln_floor;
  }
  const auto foreign = foreign_lights(registered);
  RingData data = ring_data(image, registered, *reference.rings, foreign, options.errors);
  doubt_pattern(*reference.scene, options.errors, data);
  if (std::none_of(data.used.begin(), data.used.end(), [](char u) { return u != 0; })) {
    result.reason = "no ring of any lamp could be measured";
    return;
  }
  const Night night = fit_with_outages(
      registered, reference, halo, options,
      reference.scene->with_guests(guests_of(foreign, registered, image, site, reference, options)),
      std::move(data));
  describe_lamps(night, registered, site, reference, result);
  fill_flags(night, registered, reference, options, result);
  Observation& observation = result.observation;
  const bool any_lit =
      std::any_of(night.data.lit.begin(), night.data.lit.end(), [](char l) { return l != 0; });
  if (!any_lit || observation.lights_used == 0) {
    result.reason = "every lamp of the catalogue is off";
    return;
  }
  const SigmaBounds bounds = sigma_bounds(night.fit.posterior, options.bounds);
  observation.method = Method::glow;
  observation.limit = bounds.limit;
  observation.extinction_per_m = bounds.value;
  observation.extinction_low_per_m = bounds.low;
  observation.extinction_high_per_m = bounds.high;
  if (bounds.limit == Limit::above) observation.quality.set(Quality::limit_above);
  if (bounds.limit == Limit::below) observation.quality.set(Quality::limit_below);
  if (bounds.limit == Limit::none) fill_q(night.fit, options, observation);
  fill_weather(night.fit, bounds, options, relative_humidity, observation);
}

}  // namespace lampglow::inference
