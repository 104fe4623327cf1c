// The lecture's source visibility as a part of the validation report: lamps whose light leaves a sector or a
// cone only.
#pragma once

#include <string>

#include "daemon/commands/validation.h"
#include "estimator/scattering/executor.h"

namespace lampglow::daemon {

// HTML with figures and tables.
std::string source_visibility(const ValidationOptions& options, const scattering::Executor& executor);

}  // namespace lampglow::daemon
