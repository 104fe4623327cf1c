// The day's method: from a frame and the site's targets to extinction and weather.
#pragma once

#include <optional>

#include "estimator/inference/contrast_fit.h"
#include "estimator/inference/sun.h"
#include "estimator/observation.h"
#include "estimator/photometry/radiance.h"

namespace lampglow::inference {

struct DayOptions {
  ContrastFitOptions fit;
  // A value is given while σ's upper 95 % bound over its lower is at most this: for targets of known
  // distance, and for learned ones, which tell the order and roughly the size.
  double widest_ratio = 3.0;
  double widest_ratio_learned = 20.0;
  // Fog known to be thicker than this is a value, the posterior's median, even where nothing bounds it below:
  // the WMO limits are ±50 m there.
  double dense_fog_mor_m = 150;
  double low_sun_deg = 8;          // below, targets are lit from the side or from behind: flagged
  double least_altitude_deg = -5;  // below, the sky is too dark and uneven for contrast
  double snow_ratio = 0.6;         // near targets brighter than this part of the sky are no dark targets
  double least_sky = 0.04;         // of the camera's full range, where the sun is not known
  double saturated_part = 0.25;    // of the picture: the sun is in it or close to it
};

// Is there light enough? Where the place, and so the sun, is unknown, the picture's upper third must tell.
bool daylight_enough(const photometry::RadianceImage& image, std::optional<SunPosition> sun,
                     const DayOptions& options);

// Fills observation and reason of `result` (its time and frame flags are the caller's). `monochrome`: the
// picture had no colour.
void measure_day(const photometry::RadianceImage& image, const Site& site, std::optional<SunPosition> sun,
                 bool monochrome, std::optional<double> relative_humidity, const DayOptions& options,
                 FrameResult& result);

// The flags that need no target: sun low, or in the picture.
void flag_sun(const photometry::RadianceImage& image, std::optional<SunPosition> sun,
              const DayOptions& options, Observation& observation);

// The posterior with an error of ln σ folded in that all targets share (normal, one standard deviation).
std::vector<PosteriorPoint> widened(const std::vector<PosteriorPoint>& posterior, double ln_sigma_error);

}  // namespace lampglow::inference
