#include "estimator/inference/fit_starts.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "estimator/inference/frame_cost.h"
#include "estimator/inference/lamp_powers.h"
#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

// Each lamp's light in every ring at one visibility, at its usual strength: brighter or dimmer lamps are then
// but sums of it.
struct Lights {
  std::vector<double> parameters;
  std::vector<double> light;  // rings x lamps

  std::vector<double> sum(double ln_gain, const std::vector<double>& ln_dimming) const {
    std::vector<double> factor, model(light.size() / ln_dimming.size());
    for (const double d : ln_dimming) factor.push_back(std::exp(ln_gain + d));
    for (size_t r = 0; r < model.size(); ++r)
      for (size_t j = 0; j < factor.size(); ++j) model[r] += factor[j] * light[r * factor.size() + j];
    return model;
  }
};

Lights lights_at(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
                 double mor) {
  const Layout at(scene.lamps().size());
  Lights lights{std::vector<double>(at.size(), 0.0), {}};
  std::vector<double>& p = lights.parameters;
  p[Layout::ln_sigma] = std::log(kMorTimesExtinction / mor);
  p[Layout::q] = std::min(prior_q(p[Layout::ln_sigma], options), halo.max_q());
  p[Layout::emission] = options.emission_mean;
  lights.light = scene.lights(halo, p, data.lit);
  return lights;
}

// The skies that suit the given light best, lamp by lamp: they are linear. They are added to the light.
void settle_skies(const Scene& scene, const RingData& data, std::vector<double>& p,
                  std::vector<double>& model) {
  const Layout at(scene.lamps().size());
  const double roof = Scene::roof_transmission(p[Layout::ln_sigma]);
  std::vector<double> sum(at.lamps, 0), weight(at.lamps, 0);
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    const auto lamp = static_cast<size_t>(scene.lamp_of_ring(r));
    const double w = 1.0 / (data.sigma[r] * data.sigma[r]), f = scene.sky_factor(r, roof);
    sum[lamp] += w * f * (data.value[r] - model[r]);
    weight[lamp] += w * f * f;
  }
  for (size_t j = 0; j < at.lamps; ++j)
    p[at.sky(j)] = weight[j] > 0 ? std::max(0.0, sum[j] / weight[j]) / data.sky_unit : 1.0;
  for (size_t r = 0; r < scene.ring_count(); ++r)
    model[r] +=
        data.sky_unit * p[at.sky(static_cast<size_t>(scene.lamp_of_ring(r)))] * scene.sky_factor(r, roof);
}

Start start_at(const Scene& scene, const HaloModel& halo, RingData data, const FitOptions& options,
               const Lights& lights, std::optional<double> ln_gain) {
  const Layout at(scene.lamps().size());
  std::vector<double> p = lights.parameters;
  data.ln_dimming.assign(at.lamps, 0.0);
  if (!ln_gain) {
    const std::vector<double> usual = lights.sum(0, data.ln_dimming);
    const Powers powers = likeliest_powers(scene, ring_ratios(scene, data, usual), data, options);
    data.ln_dimming = powers.ln_dimming;
    ln_gain = powers.ln_gain;
  }
  p[Layout::ln_gain] = *ln_gain;
  for (size_t j = 0; j < at.lamps; ++j) p[at.ln_strength(j)] = data.ln_dimming[j];
  std::vector<double> model = lights.sum(*ln_gain, data.ln_dimming);
  settle_skies(scene, data, p, model);
  const double cost = FrameCost(scene, halo, data, options).cost_of_model(p.data(), model) +
                      mixture_penalty(scene, data.ln_dimming, data.lit);
  return {cost, std::move(p), std::move(data.ln_dimming)};
}

}  // namespace

std::vector<Start> starts(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FitOptions& options) {
  std::vector<std::optional<double>> gains;
  if (options.gain_known)
    gains = {0.0, -0.69};
  else
    gains = {0.0, -0.7, 0.7, -1.6, 1.6};
  if (options.ln_half != 0) gains.emplace_back(std::nullopt);
  std::vector<Start> all;
  constexpr int kVisibilities = 19;  // from 35 m to 52 km
  double mor = 35;
  for (int i = 0; i < kVisibilities; ++i, mor *= 1.5) {
    const Lights lights = lights_at(scene, halo, data, options, mor);
    for (const auto& ln_gain : gains) all.push_back(start_at(scene, halo, data, options, lights, ln_gain));
  }
  std::stable_sort(all.begin(), all.end(), [](const Start& a, const Start& b) { return a.cost < b.cost; });
  std::vector<Start> best;
  for (Start& s : all) {
    const bool near = std::any_of(best.begin(), best.end(), [&](const Start& b) {
      return b.ln_dimming == s.ln_dimming &&
             std::abs(b.parameters[Layout::ln_sigma] - s.parameters[Layout::ln_sigma]) < 0.6;
    });
    if (!near) best.push_back(std::move(s));
    if (best.size() == 5) break;
  }
  return best;
}

}  // namespace lampglow::inference
