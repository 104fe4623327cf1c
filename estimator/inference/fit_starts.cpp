#include "estimator/inference/fit_starts.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "estimator/inference/frame_cost.h"
#include "estimator/inference/lamp_powers.h"
#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

// The skies that suit the given light best, lamp by lamp: they are linear.
void settle_skies(const Scene& scene, const HaloModel& halo, const RingData& data, std::vector<double>& p) {
  const Layout at(scene.lamps().size());
  for (size_t j = 0; j < at.lamps; ++j) p[at.sky(j)] = 0;
  Scene::Output output;
  scene.evaluate(halo, p, data.lit, data.sky_unit, output, false);
  std::vector<double> sum(at.lamps, 0), weight(at.lamps, 0);
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    const auto lamp = static_cast<size_t>(scene.lamp_of_ring(r));
    const double w = 1.0 / (data.sigma[r] * data.sigma[r]);
    sum[lamp] += w * (data.value[r] - output.model[r]);
    weight[lamp] += w;
  }
  for (size_t j = 0; j < at.lamps; ++j)
    p[at.sky(j)] = weight[j] > 0 ? std::max(0.0, sum[j] / weight[j]) / data.sky_unit : 1.0;
}

Start start_at(const Scene& scene, const HaloModel& halo, RingData data, const FitOptions& options,
               double mor, std::optional<double> ln_gain) {
  const Layout at(scene.lamps().size());
  std::vector<double> p(at.size(), 0.0);
  p[Layout::ln_sigma] = std::log(kMorTimesExtinction / mor);
  p[Layout::q] = std::min(prior_q(p[Layout::ln_sigma], options), halo.max_q());
  p[Layout::emission] = options.emission_mean;
  data.ln_dimming.assign(at.lamps, 0.0);
  if (!ln_gain) {
    const Powers powers = likeliest_powers(scene, ring_ratios(scene, halo, data, p), data, options);
    data.ln_dimming = powers.ln_dimming;
    ln_gain = powers.ln_gain;
  }
  p[Layout::ln_gain] = *ln_gain;
  for (size_t j = 0; j < at.lamps; ++j) p[at.ln_strength(j)] = data.ln_dimming[j];
  settle_skies(scene, halo, data, p);
  const double cost =
      cost_at(scene, halo, data, options, p) + mixture_penalty(scene, data.ln_dimming, data.lit);
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
  for (double mor = 35; mor < 60e3; mor *= 1.5)
    for (const auto& ln_gain : gains) all.push_back(start_at(scene, halo, data, options, mor, ln_gain));
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
