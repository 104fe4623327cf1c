// The report of a replay: one HTML file that needs nothing else.
#pragma once

#include <string>
#include <vector>

#include "daemon/replay/replay.h"

namespace lampglow::daemon {

// Visibility against time with its band, limits and the truth; the scores; for the worst and the typical
// frames the annotated picture and the ring profiles with the fit. Those frames are read and estimated again.
std::string format_report(const ReplayOptions& options, const ReplayResult& result,
                          const std::vector<Truth>& truths);

}  // namespace lampglow::daemon
