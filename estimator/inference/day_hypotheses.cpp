#include "estimator/inference/day_hypotheses.h"

#include <algorithm>
#include <cmath>

namespace lampglow::inference {
namespace {

// Sunlit trees and walls, low sun behind the camera: as likely as not.
constexpr double kSunlitRatio = 0.22, kSunlitSigma = 0.12, kSunlitOdds = 0.0;
constexpr double kWildSigma = 0.5;    // of a ratio that says nothing
constexpr int kMostForOneWrong = 12;  // targets; of more, the robust weights find the wrong one

ContrastFitOptions usual(const DayOptions& options, QualityFlags flags) {
  ContrastFitOptions fit = options.fit;
  if (flags.has(Quality::low_sun)) {
    fit.brightness_ratio_sigma *= options.low_sun_brightness;
    fit.brightness_ratio_common_sigma *= options.low_sun_brightness;
  }
  const bool drops = flags.has(Quality::rain_on_window), glare = flags.has(Quality::sun_in_picture);
  fit.veil_sigma = glare ? options.glare_veil_sigma : 0;
  fit.veil_common_sigma =
      std::hypot(drops ? options.drops_veil_common_sigma : 0, glare ? options.glare_veil_common_sigma : 0);
  return fit;
}

ContrastFitOptions sunlit(ContrastFitOptions fit) {
  fit.brightness_ratio = kSunlitRatio;
  fit.brightness_ratio_sigma = fit.brightness_ratio_common_sigma = kSunlitSigma;
  return fit;
}

ContrastFitOptions snowy(ContrastFitOptions fit) {
  fit.snow = true;
  return fit;
}

double least(const ContrastFit& fit) {
  double least = fit.posterior.front().minus_ln_probability;
  for (const PosteriorPoint& p : fit.posterior) least = std::min(least, p.minus_ln_probability);
  return least;
}

// Adds the other's probability, e^−odds of it. True if it then is what speaks for the best σ.
bool add_probability(ContrastFit& fit, const ContrastFit& other, double odds) {
  const bool better = least(other) + odds < least(fit);
  for (size_t i = 0; i < fit.posterior.size(); ++i) {
    double& mine = fit.posterior[i].minus_ln_probability;
    const double its = other.posterior[i].minus_ln_probability + odds;
    mine = std::min(mine, its) - std::log1p(std::exp(-std::abs(mine - its)));
  }
  if (better) fit.worst_z = other.worst_z;
  return better;
}

// All targets are right.
SceneFit fit_all_right(const DayView& view, const Site& site, const DayOptions& options, QualityFlags flags) {
  const ContrastFitOptions dark = usual(options, flags);
  SceneFit scene{fit_contrast(view, site, dark)};
  if (scene.fit.brightness_targets == 0) return scene;
  if (flags.has(Quality::low_sun))
    add_probability(scene.fit, fit_contrast(view, site, sunlit(dark)), kSunlitOdds);
  if (scene.fit.brightness_targets >= 2) {  // one white target in clear air is a dark one in fog
    const ContrastFit white = fit_contrast(view, site, snowy(dark));
    // Dark targets that contradict each other have no odds on their side, if white ones don't.
    const bool only_white = scene.fit.worst_z > options.odd_target_z && white.worst_z < options.odd_target_z;
    scene.snow = add_probability(scene.fit, white, only_white ? 0.0 : options.snow_ln_odds);
  }
  scene.odd = scene.fit.worst_z > options.odd_target_z;
  return scene;
}

// One target is wrong, it is not known which: each in turn, as far as the others then agree. Empty posterior
// if they never do.
SceneFit fit_one_wrong(const DayView& view, const Site& site, const DayOptions& options, QualityFlags flags) {
  SceneFit scene;
  for (size_t t = 0; t < view.targets.size(); ++t) {
    if (!view.targets[t].brightness_ratio) continue;
    DayView without = view;
    without.targets[t].brightness_ratio_sigma = kWildSigma;
    SceneFit others = fit_all_right(without, site, options, flags);
    if (others.odd || others.snow) continue;  // snow lies on all of them
    if (scene.fit.posterior.empty())
      scene = std::move(others);
    else
      add_probability(scene.fit, others.fit, 0);
  }
  return scene;
}

DayView doubted(DayView view, double sigma) {
  for (TargetView& target : view.targets)
    target.brightness_ratio_sigma = std::hypot(target.brightness_ratio_sigma, sigma);
  return view;
}

}  // namespace

SceneFit fit_scene(const DayView& view, const Site& site, const DayOptions& options, QualityFlags flags) {
  SceneFit scene = fit_all_right(view, site, options, flags);
  if (!scene.odd || scene.snow || scene.fit.brightness_targets > kMostForOneWrong) return scene;
  SceneFit repaired = fit_one_wrong(view, site, options, flags);
  if (repaired.fit.posterior.empty())
    repaired = fit_all_right(doubted(view, options.odd_ratio_sigma), site, options, flags);
  repaired.odd = true;
  return repaired;
}

}  // namespace lampglow::inference
