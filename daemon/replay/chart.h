// Charts as SVG text, coloured by the page's CSS classes so that they follow its light or dark scheme.
#pragma once

#include <string>
#include <vector>

#include "daemon/sources/truth.h"
#include "estimator/observation.h"

namespace lampglow::daemon {

// `<`, `>`, `&` and quotes as entities.
std::string html_text(std::string_view text);

// MOR against time on a log axis: estimate with its 95 % band, limits as triangles that point the way the
// truth lies, the truth as a line, the fog limit of 1000 m dashed.
std::string visibility_chart(const std::vector<Observation>& observations, const std::vector<Truth>& truths);

// Radiance of one lamp's rings against the angle, both on log axes: measured with one standard deviation, and
// the fit. Empty text if the lamp has no ring above zero.
std::string profile_chart(const LampFit& lamp);

}  // namespace lampglow::daemon
