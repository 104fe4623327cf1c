// The ways to read a frame: lamps at half power in thin air look much like lamps at full power in fog.
#pragma once

#include <vector>

#include "estimator/inference/joint_fit.h"
#include "estimator/inference/least_squares.h"

namespace lampglow::inference {

// One way: which lamps burn at half power (data.ln_dimming), and the best fit to it.
struct Mode {
  RingData data;
  double penalty = 0;  // −ln p of just these lamps being dimmed
  Solved solved;
  double cost() const { return solved.cost + penalty; }
};

struct Modes {
  std::vector<Mode> modes;  // best first, never empty; rivals may stand there twice
  int iterations = 0;       // of the solver, in all
};

Modes find_modes(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options);

// The best fit that is reached from `parameters`, beginning with the lamps' powers as in `like`.
Mode mode_at(const Scene& scene, const HaloModel& halo, const Mode& like, const FitOptions& options,
             std::vector<double> parameters, int& iterations);

// The best mode with its covariance, and bounds that cover its rivals.
JointFit complete(const Scene& scene, const HaloModel& halo, const FitOptions& options, Modes found);

}  // namespace lampglow::inference
