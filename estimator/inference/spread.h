// The camera's point spread with its wide glare, and each lamp's strength, from the rings of a clear night.
// Without it glare is read as fog. Nothing is assumed of its form but that it is smooth in ln θ and sums
// to 1.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "estimator/inference/joint_fit.h"
#include "estimator/inference/scene.h"

namespace lampglow::inference {

struct SpreadOptions {
  double clear_mor_m = 20e3;  // assumed where the reference night's MOR is not known ...
  double clear_q = 0.6;       // the clear night's own faint halo is taken off with this q
  double smoothness =
      0.35;  // one standard deviation of the change of slope d ln p / d ln θ from node to node
  double core_fraction = 0.95;  // prior for cameras that saturate in every lamp, and
  double core_fraction_ln_sigma = 0.03;
  double ring_error = 0.02;        // of a ring, relative to the lamp's own light
  double slope_sigma = 1.0;        // of the sky's gradient, in sky units per half picture
  std::function<bool()> given_up;  // as FitOptions'
};

struct LearnedSpread {
  PointSpread spread;
  std::vector<double> ln_strength;        // of every lamp, in clear air
  std::vector<double> ln_strength_sigma;  // of the fit alone
  std::vector<double> sky;                // background at every lamp, radiance
  bool core_seen = false;                 // most lamps' cores were unsaturated
  double chi2_per_ring = 0;
  std::vector<double> model;  // of every ring
};

// `lamps` with positions and distances (strengths are ignored); `extinction_per_m` of the clear night.
LearnedSpread learn_spread(const Camera& camera, const photometry::RingMap& map,
                           std::span<const SceneLamp> lamps, const HaloModel& halo, const RingData& data,
                           double extinction_per_m, const SpreadOptions& options);

}  // namespace lampglow::inference
