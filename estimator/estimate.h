// The pipeline: one frame in, what it says about the air out. A pure function of what is passed in.
#pragma once

#include <optional>

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

// Never throws for a bad frame: the result then has flags and a reason, and no value. Throws FitStopped soon
// after options.night.fit.given_up.
FrameResult estimate(const Bracket& bracket, const Site& site, const std::optional<ClearReference>& reference,
                     const EstimatorOptions& options);

}  // namespace lampglow
