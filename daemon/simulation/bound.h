// The least error that any unbiased estimate of a frame's extinction can have (Cramér-Rao), from the
// simulation's own noise: shot and read noise of the sensor, and the finite count of photons that drew the
// halo.
#pragma once

#include <optional>
#include <span>

#include "daemon/simulation/halo.h"
#include "daemon/simulation/night.h"
#include "daemon/simulation/sensor.h"

namespace lampglow::simulation {

// One standard deviation of ln σ; empty where no catalogue lamp gives light.
//
// What is measured: the mean of 24 rings round each lamp of the catalogue, 0.15° to 8°, each pixel given to
// its nearest lamp; and, where an exposure does not saturate, the light within 0.15°. What is unknown: ln σ;
// q; the sky; the gain, to 12 % (to a factor 4.5 where exposure is automatic); each lamp's strength, to 6 %.
// What is taken as known: the point spread, the registration, stray lights. Derivatives are finite
// differences of the counted halos; that to q is smoothed by a cubic in ln θ, since noise in a derivative
// would look like information.
std::optional<double> bound_of_ln_extinction(const Night& night, const Frame& frame, const HaloLibrary& halos,
                                             const Sensor& sensor, std::span<const double> exposures_s);

}  // namespace lampglow::simulation
