// What comes over the station for a part of the time, where it is asked for: each a stretch of two fifths of
// the frames, by day.
#pragma once

#include "daemon/simulation/night.h"

namespace lampglow::simulation {

void add_events(Night& night);

}  // namespace lampglow::simulation
