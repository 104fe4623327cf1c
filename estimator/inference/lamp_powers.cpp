#include "estimator/inference/lamp_powers.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/inference/frame_cost.h"

namespace lampglow::inference {
namespace {

double mixture_penalty(int n, int k) {
  const double ln_beta = std::lgamma(k + 0.5) + std::lgamma(n - k + 0.5) - std::lgamma(n + 1.0);
  return std::log(std::numbers::pi) - ln_beta;
}

}  // namespace

double mixture_penalty(const Scene& scene, const std::vector<double>& ln_dimming, std::span<const char> lit) {
  int n = 0;
  for (size_t j = 0; j < lit.size(); ++j) n += lit[j] && !scene.lamps()[j].guest() ? 1 : 0;
  const auto k = std::count_if(ln_dimming.begin(), ln_dimming.end(), [](double d) { return d != 0; });
  return mixture_penalty(n, static_cast<int>(k));
}

Powers likeliest_powers(const Scene& scene, const std::vector<std::optional<double>>& ln_ratio,
                        const RingData& data, const FitOptions& options) {
  constexpr double kRatioSigma = 0.04;
  const double gain_sigma = options.gain_known ? options.ln_gain_sigma : kWideGainSigma;
  const double reach = options.gain_known ? 0.6 : 3.0;
  constexpr double kStep = 0.03;
  const long steps = std::lround(2 * reach / kStep);
  Powers best;
  double gain = -reach;
  for (long i = 0; i <= steps; ++i, gain += kStep) {
    double slope = 1.0;
    const double pulled = soften(gain / gain_sigma, options.prior_tail, slope);
    Powers powers{gain, pulled * pulled / 2, std::vector<double>(ln_ratio.size(), 0.0)};
    for (size_t j = 0; j < ln_ratio.size(); ++j) {
      if (!ln_ratio[j] || !data.lit[j]) continue;
      const double rest = *ln_ratio[j] - gain;
      if (std::abs(rest - options.ln_half) < std::abs(rest)) powers.ln_dimming[j] = options.ln_half;
      const double sigma = std::hypot(scene.lamps()[j].ln_strength_sigma, kRatioSigma);
      const double off = soften((rest - powers.ln_dimming[j]) / sigma, options.prior_tail, slope);
      powers.cost += off * off / 2;
    }
    powers.cost += mixture_penalty(scene, powers.ln_dimming, data.lit);
    if (powers.cost < best.cost) best = std::move(powers);
  }
  return best;
}

std::vector<std::optional<double>> ring_ratios(const Scene& scene, const RingData& data,
                                               std::span<const double> light) {
  const Layout at(scene.lamps().size());
  struct Sums {
    double w = 0, x = 0, y = 0, xx = 0, xy = 0;
  };
  std::vector<Sums> sums(at.lamps);
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    Sums& s = sums[static_cast<size_t>(scene.lamp_of_ring(r))];
    const double w = 1.0 / (data.sigma[r] * data.sigma[r]), x = light[r], y = data.value[r];
    s.w += w, s.x += w * x, s.y += w * y, s.xx += w * x * x, s.xy += w * x * y;
  }
  std::vector<std::optional<double>> ratios(at.lamps);
  for (size_t j = 0; j < at.lamps; ++j) {
    const Sums& s = sums[j];
    const double spread = s.w * s.xx - s.x * s.x, slope = s.w * s.xy - s.x * s.y;
    if (spread > 0 && slope > 0) ratios[j] = std::log(slope / spread);
  }
  return ratios;
}

}  // namespace lampglow::inference
