#include "estimator/inference/modes.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "estimator/inference/fit_starts.h"
#include "estimator/inference/frame_cost.h"
#include "estimator/inference/lamp_powers.h"
#include "estimator/inference/profile.h"

namespace lampglow::inference {
namespace {

bool by_cost(const Mode& a, const Mode& b) {
  return a.cost() < b.cost();
}

Mode mode_from(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
               std::vector<double> parameters, std::vector<double> ln_dimming, int max_iterations) {
  Mode mode;
  mode.data = data;
  mode.data.ln_dimming = std::move(ln_dimming);
  if (options.ln_half != 0) mode.penalty = mixture_penalty(scene, mode.data.ln_dimming, data.lit);
  const FrameCost cost(scene, halo, mode.data, options);
  mode.solved =
      solve(scene, cost, mode.data, options, std::move(parameters), false, max_iterations, halo.max_q());
  return mode;
}

// Chooses the lamps' powers anew by the fit's own strengths, while that makes the fit better.
Mode settled(const Scene& scene, const HaloModel& halo, const FitOptions& options, Mode mode,
             int& iterations) {
  if (options.ln_half == 0) return mode;
  const Layout at(scene.lamps().size());
  for (int round = 0; round < 3; ++round) {
    std::vector<double> p = mode.solved.parameters;
    std::vector<std::optional<double>> ratios(at.lamps);
    for (size_t j = 0; j < at.lamps; ++j)
      if (!scene.lamps()[j].guest()) ratios[j] = p[Layout::ln_gain] + p[at.ln_strength(j)];
    Powers powers = likeliest_powers(scene, ratios, mode.data, options);
    if (powers.ln_dimming == mode.data.ln_dimming) break;
    for (size_t j = 0; j < at.lamps; ++j) p[at.ln_strength(j)] += p[Layout::ln_gain] - powers.ln_gain;
    p[Layout::ln_gain] = powers.ln_gain;
    Mode next = mode_from(scene, halo, mode.data, options, std::move(p), std::move(powers.ln_dimming),
                          options.max_iterations);
    iterations += next.solved.iterations;
    if (next.cost() >= mode.cost()) break;
    mode = std::move(next);
  }
  return mode;
}

// Is it on its way to where another start has come to already? Not if it is deeper than that one.
bool joins(const Scene& scene, const Mode& mode, const std::vector<Mode>& found) {
  constexpr double kNearLnSigma = 0.05, kNearStrength = 0.15, kNearQ = 0.1, kSameCost = 0.1;
  const Layout at(scene.lamps().size());
  const auto near = [&](const Mode& other, size_t parameter, double reach) {
    return std::abs(other.solved.parameters[parameter] - mode.solved.parameters[parameter]) < reach;
  };
  return std::any_of(found.begin(), found.end(), [&](const Mode& other) {
    bool same = other.data.ln_dimming == mode.data.ln_dimming &&
                other.solved.cost < mode.solved.cost + kSameCost &&
                near(other, Layout::ln_sigma, kNearLnSigma) && near(other, Layout::q, kNearQ) &&
                near(other, Layout::ln_gain, kNearStrength);
    for (size_t j = 0; j < at.lamps && same; ++j) same = near(other, at.ln_strength(j), kNearStrength);
    return same;
  });
}

// The best fit from each start, best first. Most starts fall into one and the same minimum: those that come
// near it within a few steps are not followed to its bottom, nor those that are far above it by then.
std::vector<Mode> modes_from_starts(const Scene& scene, const HaloModel& halo, const RingData& data,
                                    const FitOptions& options, int& iterations) {
  constexpr int kFew = 5;
  constexpr double kHopeless = 100;
  std::vector<Mode> modes;
  double least = std::numeric_limits<double>::infinity();
  for (const Start& start : starts(scene, halo, data, options)) {
    std::vector<double> parameters = start.parameters;
    for (const int steps : {kFew, options.max_iterations}) {
      Mode mode = mode_from(scene, halo, data, options, parameters, start.ln_dimming,
                            modes.empty() ? options.max_iterations : std::min(steps, options.max_iterations));
      iterations += mode.solved.iterations;
      if (joins(scene, mode, modes)) break;
      if (steps == kFew && !mode.solved.converged && !modes.empty()) {
        parameters = mode.solved.parameters;
        continue;
      }
      if (mode.cost() > least + kHopeless) break;
      modes.push_back(settled(scene, halo, options, std::move(mode), iterations));
      least = std::min(least, modes.back().cost());
      break;
    }
  }
  std::stable_sort(modes.begin(), modes.end(), by_cost);
  return modes;
}

// By how much the cost would rise, to second order, if the lamp's usual power were another: the rest of the
// frame's say on its strength is a parabola, the prior a Cauchy about either power.
double rise_if_flipped(const Scene& scene, const FitOptions& options, const Mode& mode, size_t lamp,
                       double variance, double ln_dimming) {
  const double sigma = scene.lamps()[lamp].ln_strength_sigma;
  const double at = mode.solved.parameters[Layout(scene.lamps().size()).ln_strength(lamp)];
  const auto prior = [&](double strength, double mean) {
    double slope = 0;
    const double r = soften((strength - mean) / sigma, options.prior_tail, slope);
    return r * r / 2;
  };
  double slope = 0;
  const double usual = mode.data.ln_dimming[lamp];
  const double pull = soften((at - usual) / sigma, options.prior_tail, slope) * slope / sigma;
  const double known = std::max(1 / variance - slope * slope / (sigma * sigma), 1e-6);
  const double middle = at + pull / known;  // where the rest alone would have it
  const auto rest = [&](double strength) { return known * (strength - middle) * (strength - middle) / 2; };
  double least = std::numeric_limits<double>::infinity();
  constexpr int kPoints = 64;
  for (int i = 0; i <= kPoints; ++i) {
    const double strength = std::lerp(middle, ln_dimming, static_cast<double>(i) / kPoints);
    least = std::min(least, rest(strength) + prior(strength, ln_dimming));
  }
  std::vector<double> dimming = mode.data.ln_dimming;
  dimming[lamp] = ln_dimming;
  return least - rest(at) - prior(at, usual) + mixture_penalty(scene, dimming, mode.data.lit) - mode.penalty;
}

// Lamps at half power in a far lamp's case are told from thicker air by the others alone: tries the other
// power of each lamp, one by one, and keeps what fits better. Rivals that come near are handed back too.
std::vector<Mode> with_powers_flipped(const Scene& scene, const HaloModel& halo, const FitOptions& options,
                                      Mode best, int& iterations) {
  constexpr double kNear = 3.0, kHopeless = kNear + 3.0;
  const Layout at(scene.lamps().size());
  std::vector<Mode> rivals;
  for (int round = 0; round < 3; ++round) {
    std::vector<Mode> tried;
    const std::vector<double> deviations = covariance_at(scene, FrameCost(scene, halo, best.data, options),
                                                         best.data, options, best.solved.parameters)
                                               .deviations;
    for (size_t j = 0; j < at.lamps; ++j) {
      if (!best.data.lit[j] || scene.lamps()[j].guest()) continue;
      std::vector<double> dimming = best.data.ln_dimming, p = best.solved.parameters;
      dimming[j] = dimming[j] != 0 ? 0.0 : options.ln_half;
      const double deviation = deviations[at.ln_strength(j)];
      if (deviation > 0 &&
          rise_if_flipped(scene, options, best, j, deviation * deviation, dimming[j]) > kHopeless)
        continue;
      p[at.ln_strength(j)] += dimming[j] - best.data.ln_dimming[j];
      tried.push_back(mode_from(scene, halo, best.data, options, std::move(p), std::move(dimming),
                                options.max_iterations));
      iterations += tried.back().solved.iterations;
    }
    if (tried.empty()) break;
    std::stable_sort(tried.begin(), tried.end(), by_cost);
    for (const Mode& mode : tried)
      if (mode.cost() < best.cost() + kNear) rivals.push_back(mode);
    if (tried.front().cost() >= best.cost()) break;
    rivals.push_back(best);
    best = tried.front();
  }
  rivals.push_back(std::move(best));
  return rivals;
}

bool burns_unlike_usual(const Mode& mode) {
  constexpr double kUnusualGain = 0.3;
  return std::abs(mode.solved.parameters[Layout::ln_gain]) > kUnusualGain ||
         std::any_of(mode.data.ln_dimming.begin(), mode.data.ln_dimming.end(),
                     [](double d) { return d != 0; });
}

}  // namespace

Mode mode_at(const Scene& scene, const HaloModel& halo, const Mode& like, const FitOptions& options,
             std::vector<double> parameters, int& iterations) {
  return settled(scene, halo, options,
                 mode_from(scene, halo, like.data, options, std::move(parameters), like.data.ln_dimming,
                           options.max_iterations),
                 iterations);
}

Modes find_modes(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options) {
  Modes found;
  std::vector<Mode>& modes = found.modes;
  modes = modes_from_starts(scene, halo, data, options, found.iterations);
  if (options.ln_half == 0 || !options.gain_known || !burns_unlike_usual(modes.front())) return found;
  for (Mode& mode : with_powers_flipped(scene, halo, options, modes.front(), found.iterations))
    modes.push_back(std::move(mode));
  std::stable_sort(modes.begin(), modes.end(), by_cost);
  return found;
}

}  // namespace lampglow::inference
