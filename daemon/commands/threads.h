// Threads that a command lends to a long computation of the estimator.
#pragma once

#include "estimator/scattering/executor.h"

namespace lampglow::daemon {

// Runs tasks on this many threads (0: one per core). The first exception of a task is thrown when all have
// ended.
scattering::Executor threads(unsigned count);

}  // namespace lampglow::daemon
