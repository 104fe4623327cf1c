// Extinction by day from the targets of one frame: Bouguer's attenuation and Koschmieder's airlight,
// E(d) = E0 exp(−σd) + E∞ (1 − exp(−σd)), all targets together.
#pragma once

#include <array>
#include <vector>

#include "estimator/inference/contrast.h"
#include "estimator/inference/posterior.h"
#include "estimator/site.h"

namespace lampglow::inference {

struct ContrastFitOptions {
  double mor_least_m = 20;  // ends of the posterior
  double mor_most_m = 200e3;
  int points = 240;
  // Intrinsic brightness of a dark target over the horizon sky's, where nothing was learned: a forest has
  // 0.02 to 0.15, more where the sun shines on it (Duntley 1948; Middleton 1952, ch. 4).
  double brightness_ratio = 0.08;
  double brightness_ratio_sigma = 0.03;         // of each target
  double brightness_ratio_common_sigma = 0.03;  // of all alike: the sun's height and direction
  // Under snow or frost, whatever was learned without it: fresh snow in the open has 0.8 to 0.9, a snowy
  // forest 0.3 to 0.7 (Middleton 1952, ch. 4).
  bool snow = false;
  double snow_ratio = 0.65;
  double snow_ratio_sigma = 0.12;        // of each target, and of all alike
  double airlight_sigma = 0.006;         // E∞ over the sky measured above the target, each target
  double airlight_common_sigma = 0.006;  // and all alike
  double haze_sigma = 0.04;              // relative unevenness of σ between the paths
  // Contrast lost, as a part of it, before the lens: drops and glare lay a veil over target and sky. None as
  // long as nothing says so.
  double veil_sigma = 0;         // of each target
  double veil_common_sigma = 0;  // of all alike
  double lighting_sigma = 1.0;   // of the lighting factors
  double outlier_z = 2.0;        // residuals beyond weigh less (Cauchy)
};

struct ContrastFit {
  std::vector<PosteriorPoint> posterior;  // of ln σ, flat prior; empty if no target could be used
  int brightness_targets = 0;             // that the posterior rests on
  int contrast_targets = 0;
  std::array<double, 2> lighting{};  // at the best point
  double worst_z = 0;                // of a brightness against the others, where there are three or more
};

ContrastFit fit_contrast(const DayView& view, const Site& site, const ContrastFitOptions& options = {});

// The model of a brightness ratio, E(d)/E∞ with intrinsic ratio r0, at optical thickness T.
inline double airlight_ratio(double r0, double transmission) {
  return 1.0 - (1.0 - r0) * transmission;
}

// The model of ln gradient energy at log_contrast (lighting and haze included), with the energies that stay.
double log_gradient_energy(double log_contrast, double floor_energy, double noise_energy);
// Its slope against log_contrast, where it is `log_energy`.
double gradient_energy_slope(double log_contrast, double log_energy);

}  // namespace lampglow::inference
