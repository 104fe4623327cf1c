// From what is true in a frame to the light that the sensor expects: lamps, halos, sky, cars, through the
// lens.
#pragma once

#include "daemon/simulation/halo.h"
#include "daemon/simulation/night.h"
#include "daemon/simulation/optics.h"
#include "estimator/photometry/image.h"

namespace lampglow::simulation {

// The usual lamp at 60 m without air: electrons per second in all pixels together.
inline constexpr double kLampElectronsPerS = 7.5e6;
inline constexpr double kLampReferenceDistance_m = 60;

// A picture is drawn with this margin, so that the lens also spreads light from just outside.
inline constexpr int kMarginPx = 62;

struct PixelPosition {
  double x_px = 0, y_px = 0;
};

// Where a point of the resting camera's picture is in a shaken one.
PixelPosition shaken(const Frame& frame, double x_px, double y_px);

// Electrons per second that a lamp of the list would send without air, its state and the camera's gain
// included.
double lamp_electrons_per_s(const Night& night, const Frame& frame, size_t lamp);

class Renderer {
 public:
  Renderer(const Night& night, const HaloLibrary& halos);

  // Expected electrons per second of each pixel, without the moving lights.
  Image<double> still_scene(const Frame& frame) const;

  // Adds the cars as they are during an exposure that starts and ends at these times after the frame's.
  void add_cars(Image<double>& picture, const Frame& frame, double start_s, double end_s) const;

 private:
  void add_sky(Image<double>& canvas, const Frame& frame) const;
  HaloProfile halo_of_lamp(const Frame& frame, size_t lamp) const;
  void add_halo(Image<double>& canvas, const HaloProfile& halo, PixelPosition lamp,
                double electrons_per_s) const;

  const Night& night_;
  const HaloLibrary& halos_;
  PointSpread spread_;
  Lens lens_;
};

}  // namespace lampglow::simulation
