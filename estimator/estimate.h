// The pipeline: one frame in, what it says about the air out. A pure function of what is passed in.
#pragma once

#include <optional>
#include <span>

#include "estimator/inference/combine.h"
#include "estimator/inference/contrast_day.h"
#include "estimator/inference/halo_models.h"
#include "estimator/inference/night.h"
#include "estimator/inference/patches.h"
#include "estimator/inference/reference.h"
#include "estimator/observation.h"
#include "estimator/photometry/exposure.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/registration.h"
#include "estimator/site.h"

namespace lampglow {

struct EstimatorOptions {
  inference::HaloKind model = inference::HaloKind::table;  // the one that measures best
  std::optional<double> relative_humidity;                 // 0..1, where the station has a hygrometer
  photometry::RadianceOptions radiance;
  photometry::RegistrationOptions registration;
  inference::ReferenceOptions reference;
  inference::NightOptions night;
  inference::PatchOptions patches;
  inference::DayOptions day;
  inference::CombineOptions combine;
  double moved_px = 7.5;  // a shift beyond this is no wind shake, which has a σ of 2.5 px: flagged
};

// The clear reference from one or several clear brackets; empty if none of them shows a lamp of the
// catalogue.
std::optional<ClearReference> learn_reference(std::span<const Bracket> clear, const Site& site,
                                              const EstimatorOptions& options);

// The targets as the daylight frames among the clear brackets show them (Target::clear), so that drops on the
// window and shadows are known when they come. Without such frames, or where the site's position is unknown,
// they are not.
void learn_targets(std::span<const Bracket> clear, Site& site, const EstimatorOptions& options);

// Never throws for a bad frame: the result then has flags and a reason, and no value.
FrameResult estimate(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     const EstimatorOptions& options);

}  // namespace lampglow
