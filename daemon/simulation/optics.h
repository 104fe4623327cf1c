// The lens: a sharp core and a wide glare, for lamps and for their halos alike.
#pragma once

#include <memory>

#include "estimator/photometry/image.h"

namespace lampglow::simulation {

struct PointSpread {
  double core_sigma_px = 1.0;  // Gaussian
  double glare_share = 0.03;   // of the energy, in two skirts a/(2π (r² + a²)^1.5), which integrate to 1
  double near_glare_px = 5;    // a of the inner skirt: 0.27°
  double near_share = 0.6;     // of the glare
  double far_glare_px = 30;    // a of the outer one: 1.6°, it reaches several degrees
};

// Glare at a distance of r_px from a point of unit energy, per pixel.
double glare(const PointSpread& spread, double r_px);

// Adds a point of light at (x, y), pixel centres at .5, of `energy` in all: its core integrated over each
// pixel.
void add_point(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy);

// The two parts of it: energy (1 - glare_share) in the core, the rest in the glare.
void add_core(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy);
void add_glare(Image<double>& picture, const PointSpread& spread, double x_px, double y_px, double energy);

// Convolves pictures of one size with the point spread. The picture's edges wrap round, so leave a margin.
class Lens {
 public:
  Lens(const PointSpread& spread, int width_px, int height_px);
  ~Lens();
  Lens(const Lens&) = delete;
  Lens& operator=(const Lens&) = delete;

  void blur(Image<double>& picture) const;

 private:
  struct Spectrum;
  std::unique_ptr<Spectrum> spectrum_;
};

}  // namespace lampglow::simulation
