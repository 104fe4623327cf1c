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
  // Bounds are so many times as wide as the fit of targets of known distance says: without it 162 of 180
  // truths of six simulated days lay within them, with it 83 instead of 76 of the worse three days' 90.
  double inflate = 1.2;
  // Fog known to be thicker than this is a value, the posterior's median, even where nothing bounds it below:
  // the WMO limits are ±50 m there.
  double dense_fog_mor_m = 150;
  double low_sun_deg = 8;          // below, targets are lit from the side or from behind: flagged
  double least_altitude_deg = -5;  // below, the sky is too dark and uneven for contrast
  double snow_ratio = 0.6;         // near targets brighter than this part of the sky are no dark targets
  double least_sky = 0.04;         // of the camera's full range, where the sun is not known
  double saturated_part = 0.25;    // of the picture: the sun is in it or close to it
  // Handling. A drop before a target or the sky above it shows another part of the scene: the ratio of the
  // two is off by this much for targets behind drops and for those too faint to tell, and by less for the
  // others.
  double drops_ratio_sigma = 0.2, clear_ratio_sigma = 0.04;
  // Where one target does not fit the others and nothing says why (a shadow's edge, a drop that is not known
  // for one, a lorry), it is not clear which of them is wrong: the ratios of all may be.
  double odd_ratio_sigma = 0.08;
  // Drops and glare lay a veil over target and sky: a part of the contrast is lost, of each target and of all
  // alike.
  double drops_veil_common_sigma = 0.1;
  double glare_veil_sigma = 0.05, glare_veil_common_sigma = 0.15;
  double low_sun_brightness = 2;  // times the intrinsic brightness's standard deviations
  // Added to the error of ln σ where contrast is not fitted target by target but learned, squares added.
  double drops_ln_sigma = 0.4, glare_ln_sigma = 0.3;
  double snow_ln_odds = 4;  // against snow, before anything is seen
  // Shadows: one half of a target is brighter than the other by so much of the sky's brightness, against the
  // clear reference and freed of haze, and by so many standard deviations; or a target's brightness is so
  // many off.
  double shadow_step = 0.03, shadow_z = 6, odd_target_z = 3.5;
  double least_transmission = 0.3;  // to a target whose halves are compared
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

// rain_on_window, where the clear references let it be told.
void flag_window(const photometry::RadianceImage& image, const Site& site, Observation& observation);

// Widens the bounds of a learned method's value by what its flags say of the window and of glare.
void widen_for_scene(const DayOptions& options, Observation& observation);

// The posterior with an error of ln σ folded in that all targets share (normal, one standard deviation).
std::vector<PosteriorPoint> widened(const std::vector<PosteriorPoint>& posterior, double ln_sigma_error);

}  // namespace lampglow::inference
