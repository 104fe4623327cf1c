// What a camera and its lamps look like in clear air: the yardstick of every later frame.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/inference/scene.h"
#include "estimator/inference/spread.h"
#include "estimator/photometry/profiles.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/registration.h"
#include "estimator/site.h"
#include "estimator/time.h"

namespace lampglow {

struct ReferenceLamp {
  std::string id;  // of the catalogue; "stray-1" and so on for lights that are in none
  double x_px = 0, y_px = 0;
  double strength =
      0;  // sum over its picture's pixels (radiance times px²), freed of the reference night's extinction
  double strength_rel_sigma = 0;  // its usual variation from night to night, and the uncertainty of the above
  bool catalogued = true;
  double ln_relearned = 0;  // of strength over what the clear brackets gave: the sum of what service taught
  std::optional<TimePoint> relearned_utc{};  // when last; empty: never
  double ln_halo = 0;  // of its halo's strength in fog over an even lamp's, against all lamps': learn_halos.h
  std::optional<TimePoint> halo_utc{};  // when it was last learned; empty: never
};

// A value: copies share the precomputed scene, which never changes.
struct ClearReference {
  std::vector<ReferenceLamp> lamps;
  TimePoint learned_utc{};      // of the newest bracket in it
  int frames = 0;               // brackets
  std::optional<double> mor_m;  // of that night, where it is known
  bool relative = false;        // no exposure times: strengths are this frame's linear DN
  bool core_seen = true;        // false: every lamp's core was saturated
  double sky = 0;               // median background, radiance
  double chi2_per_ring = 0;     // of the point spread's fit
  inference::PointSpread spread;
  std::vector<photometry::CatalogueLamp> catalogue;  // all of `lamps`, with core fluxes, for registration
  std::vector<photometry::PixelIndex> hot_pixels;
  std::shared_ptr<const photometry::RingMap> rings;
  std::shared_ptr<const inference::Scene> scene;
};

namespace inference {

struct ReferenceOptions {
  photometry::RingOptions rings;
  SpreadOptions spread;
  double lamp_rel_sigma = 0.06;     // usual variation of one lamp
  double clear_mor_ln_sigma = 0.6;  // how far an assumed clear night's MOR may be off
  double stray_min_part = 0.004;  // lights in no catalogue count from this part of the median lamp's flux on
  int max_strays = 12;
  double stray_distance_m = 350;       // their distance is a guess ...
  double stray_distance_ln_sigma = 1;  // ... and this uncertain
};

// Which lights and rings a reference is made of: laid out on its first clear bracket.
struct ReferenceLayout {
  std::vector<photometry::CatalogueLamp> catalogue;  // with the lights that are in none
  std::shared_ptr<const photometry::RingMap> rings;
  ReferenceOptions options;
};

ReferenceLayout lay_out(const photometry::RadianceImage& first, const photometry::RegisteredFrame& registered,
                        const Site& site, std::span<const photometry::CatalogueLamp> catalogue,
                        const ReferenceOptions& options);

// What is left of a clear bracket when its picture is gone.
struct ClearFrame {
  RingData rings;
  photometry::RegisteredFrame registered;
  bool relative = false;
  TimePoint time_utc{};
  std::optional<double> mor_m;
};

RingData clear_rings(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                     const ReferenceLayout& layout);

// Empty if the first frame shows no lamp of the catalogue.
std::optional<ClearReference> learn_clear_reference(std::span<const ClearFrame> frames,
                                                    const ReferenceLayout& layout, const Site& site,
                                                    const HaloModel& halo);

// The rings of a frame as data for a fit: sigma holds noise and model error. `foreign` lights' surroundings
// are left out.
struct RingErrors {
  double of_light = 0.02;         // relative, of what the ring has above the sky
  double of_sky = 0.002;          // relative, of the whole
  double of_coloured_sky = 0.01;  // instead of of_sky for 8-bit colour
  double of_wide_sky = 0.02;      // the same at 9°, growing as θ²: the sky is no plane
  double of_pattern =
      0.5;  // of what the reference showed over its smooth sky: roofs fade, domes of light do not
  double relative_core =
      0.1;  // instead of of_light for the cores of one 8-bit exposure: nearly saturated, compressed
  double steep = 0.08;  // instead of of_light within 1.5 core radii, where the core's skirt is steep
};
// Around a foreign light the frame's pixels are left out: its core, and its glare down to a part of the sky.
double foreign_radius_px(const photometry::DetectedLight& light);

RingData ring_data(const photometry::RadianceImage& image, const photometry::RegisteredFrame& registered,
                   const photometry::RingMap& map, std::span<const photometry::DetectedLight> foreign,
                   const RingErrors& errors);

}  // namespace inference
}  // namespace lampglow
