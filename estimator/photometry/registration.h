// Where the lamps of the catalogue are in this frame: shift and small rotation against the reference, and
// what each lamp looks like here.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/photometry/lamps.h"
#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::photometry {

struct CatalogueLamp {
  std::string id;
  double x_px = 0;  // in the reference
  double y_px = 0;
  double position_sigma_px = 0.7;  // how well that is known, each axis; a site file says ±1 px
  std::optional<double>
      core_flux;  // in the clear reference, as LampSighting::core_flux; helps to tell which light is which
};
std::vector<CatalogueLamp> catalogue_of(const Site& site);

// One lamp of the catalogue in one frame.
struct LampSighting {
  std::string id;
  // A candidate only, from the picture alone: seen, saturated, faded (a halo without a core), off (nothing
  // there) or unknown (outside the picture, or masked). The fit decides between faded, off and hidden.
  LampState state = LampState::unknown;
  double x_px = 0;  // best position in this frame
  double y_px = 0;
  double position_sigma_px = 0;  // one standard deviation, each axis
  bool own_centroid = false;     // false: position is the frame's transform alone
  double core_flux = 0;          // over the core aperture above the ring around it, radiance times px²
  double core_flux_sigma = 0;
  double background = 0;  // in the ring around the core, radiance
  double peak = 0;        // highest pixel above it
  double snr = 0;
  int saturated_pixels = 0;  // in the core aperture
};

struct RegisteredFrame {
  bool registered = false;  // false: shift and rotation are zero for want of any lamp
  double shift_x_px = 0;    // frame = centre + R(rotation)·(reference - centre) + shift
  double shift_y_px = 0;
  double rotation_rad = 0;    // positive turns x towards y
  double shift_sigma_px = 0;  // one standard deviation, each axis
  double rotation_sigma_rad = 0;
  int lamps_used = 0;
  std::vector<LampSighting> lamps;    // one for each of the catalogue, in its order
  std::vector<DetectedLight> strays;  // lights in no catalogue, brightest first

  // Where a point of the reference is in this frame.
  void to_frame(double& x_px, double& y_px, int width_px, int height_px) const;
};

struct RegistrationOptions {
  double max_shift_px = 12;
  double max_rotation_rad = 0.01;
  double usual_shift_px =
      3;  // one standard deviation of the camera's shake: settles which of two lights is the lamp
  double usual_rotation_rad = 0.002;
  double match_px = 2.5;    // a light farther than this from any lamp of the catalogue is a stray
  bool find_strays = true;  // false: only look near the catalogue's lamps (faster)
  DetectionOptions detection{.mesh_samples = 8, .threshold_sigma = 8, .binning = 2};
  CentroidOptions centroid{};
};

RegisteredFrame register_frame(const RadianceImage& image, std::span<const CatalogueLamp> catalogue,
                               const RegistrationOptions& options = {});

// The catalogue with positions and core fluxes as the clear frames show them: each lamp's median over the
// frames in which it was seen, brought back to the reference. Lamps never seen stay as they are.
std::vector<CatalogueLamp> refine_catalogue(std::span<const CatalogueLamp> catalogue,
                                            std::span<const RegisteredFrame> clear, int width_px,
                                            int height_px);

// Lights in no catalogue in both frames that are near each other but not in the same place: on the move.
std::vector<DetectedLight> moving_lights(const RegisteredFrame& before, const RegisteredFrame& now,
                                         double least_px = 2, double most_px = 80);

}  // namespace lampglow::photometry
