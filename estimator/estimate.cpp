#include "estimator/estimate.h"

namespace lampglow {

std::optional<ClearReference> learn_reference(std::span<const Bracket>, const Site&,
                                              const EstimatorOptions&) {
  return std::nullopt;
}

FrameResult estimate(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     const EstimatorOptions&) {
  FrameResult result;
  result.observation.time_utc = bracket.time_utc;
  result.observation.quality = bracket.quality;
  result.reason = bracket.fault;
  if (site.lights.empty()) result.observation.quality.set(Quality::no_lights);
  if (!reference) result.observation.quality.set(Quality::no_reference);
  return result;
}

}  // namespace lampglow
