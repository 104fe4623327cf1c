// Which pixels of a picture belong to which ring round which lamp. Every pixel belongs to the lamp that
// dominates it (strength over angle squared), so that none counts twice and the rings of a frame are
// independent of each other.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/image.h"

namespace lampglow::photometry {

struct RingOptions {
  double core_radius_px =
      3.5;         // innermost "ring" is a disc that holds the lens' core whatever its sub-pixel phase
  int rings = 40;  // disc included, edges log-spaced in angle
  double max_theta_deg = 9.0;  // outer edge of the last ring
  int min_pixels = 12;         // rings with fewer good pixels are dropped
  double clip_sigma =
      5.0;  // pixels farther than this from the ring's median (by its median deviation) are dropped
  // Of each picture column the first row that is no sky, -1 for none; empty if not known. The sky is smooth
  // and part of the fit's model, what stands before it is not: outer rings are then made of sky alone.
  std::vector<int> skyline_px = {};
  int skyline_margin_px = 4;  // for a shaking camera and the lens' spread
};

// Where a lamp is in the picture, pixel centres at .5, and how it divides the picture with its neighbours.
struct RingCentre {
  double x_px = 0, y_px = 0;
  double weight = 1.0;  // relative strength, > 0
};

// Unit vector of a picture point, camera's axis = +z.
struct Direction {
  double x = 0, y = 0, z = 1;
};

// The pinhole's rays. Without a focal length the angle of view is guessed as 40°: `known` is then false.
struct AngularScale {
  explicit AngularScale(const Camera& camera);
  Direction direction(double x_px, double y_px) const;
  double pixel_solid_angle_sr(double x_px, double y_px) const;  // cos³ of the field angle over f²
  double focal_length_px = 0, principal_x_px = 0, principal_y_px = 0;
  bool known = false;
};

double angle_rad(const Direction& a, const Direction& b);
// Distance in the image plane over the focal length: the angle [rad] that it would be on the axis.
double plane_distance(const Direction& a, const Direction& b);

// One ring of one lamp. Sample points stand for its pixels where a model has to be averaged over it.
struct Ring {
  int lamp = 0;
  double theta_low_rad = 0, theta_high_rad = 0, theta_mean_rad = 0;
  std::vector<Direction> samples;
  double mean_x_px = 0, mean_y_px = 0;
};

// Two bytes, because a map has one for every pixel.
using RingIndex = std::int16_t;
inline constexpr std::size_t kMaxRings = std::numeric_limits<RingIndex>::max();

// Pixels side by side in a row that belong to one ring.
struct RingRun {
  RingIndex ring;
  int first_column, last_column;
};

// Which pixel belongs to which ring: computed once for a reference, used for every frame of it.
struct RingMap {
  std::vector<RingCentre> centres;
  std::vector<Ring> rings;         // lamp by lamp, inside out, options.rings each
  std::vector<double> edges_rad;   // options.rings + 1, first 0
  Image<RingIndex> ring_of_pixel;  // -1: none
  // The same as runs, which frames are read by; row y's are first_run[y] up to first_run[y + 1].
  std::vector<RingRun> runs;
  std::vector<std::size_t> first_run;
  RingOptions options;
  double inner_zone_rad = 0;  // within this angle rings are measured with sub-pixel weights
};

// Throws std::invalid_argument where the lamps would have more than kMaxRings rings.
RingMap make_ring_map(const Camera& camera, std::span<const RingCentre> centres, const RingOptions& options);

}  // namespace lampglow::photometry
