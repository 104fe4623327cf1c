// The project's random numbers, under this namespace's name.
#pragma once

#include "estimator/scattering/random.h"

namespace lampglow::simulation {

using scattering::Random;

}  // namespace lampglow::simulation
