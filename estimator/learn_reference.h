// From clear brackets to the yardstick of every later frame.
#pragma once

#include <cstddef>
#include <functional>
#include <optional>

#include "estimator/estimate.h"
#include "estimator/inference/reference.h"
#include "estimator/photometry/exposure.h"
#include "estimator/site.h"

namespace lampglow {

// Each is read when it is needed, twice in all, and let go again: the pictures of a night don't fit into a
// small machine's memory.
struct ClearBrackets {
  std::size_t count = 0;
  std::function<Bracket(std::size_t)> load;  // of 0 to count - 1
};

// The clear reference from one or several clear brackets; empty if none of them shows a lamp of the
// catalogue. Throws FitStopped soon after options.night.fit.given_up, and so does learn_targets().
std::optional<ClearReference> learn_reference(const ClearBrackets& clear, const Site& site,
                                              const EstimatorOptions& options);

// The targets as the daylight frames among the clear brackets show them (Target::clear), so that drops on the
// window and shadows are known when they come. Without such frames, or where the site's position is unknown,
// they are not.
void learn_targets(const ClearBrackets& clear, Site& site, const EstimatorOptions& options);

}  // namespace lampglow
