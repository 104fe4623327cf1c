// The forward model of a night picture: what every ring of every lamp should read, given the air.
//
//   ring k of lamp i = s_k (sky_i + gradient·r_k) + gain Σ_j A_j [ d_k e^(−T_j) D_kj + κ h_j 4π ω_j (W K
//   G_j)_k ], T_j = σ R_j
//
// d_k, s_k: what the clear reference showed in this ring over its smooth model, about 1: a lens that is not
// round, and roofs before the sky, which fade in fog (s_k − 1 goes as e^(−σ R_roofs)).
// A_j: what the lamp's picture sums to in clear air (over pixels); D: the camera's point spread, averaged
// over the ring; G_j(θ) = T² g(T, q, θ) (1 + c s(θ)): scattered radiance of a lamp of unit irradiance, g from
// the glow model in optical units per unit flux (hence 4π), ω_j the solid angle of a pixel there; K spreads
// the halo by the lens' wide glare; W averages over the ring's own pixels. h and c: street lights are
// luminaires, their halo is stronger against their beam than an even lamp's, the more so at wide angles (s
// grows from 0 at 1° to 1 at 4°) and in air of low q (luminaire.h: what nights taught of each). κ: the same
// for all lamps, for cameras whose lamp cores are saturated, so that the direct beam is known by its glare
// alone. All halos add up, so neighbours are part of the model.
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/photometry/profiles.h"

namespace lampglow::inference {

// Scattered light of an isotropic point lamp in optical units per unit flux (as in physics.md) and its
// derivatives.
class HaloModel {
 public:
  virtual ~HaloModel() = default;
  // For every angle: value, d/d ln T, d/d q (both empty: not wanted). T and q are within the limits below.
  virtual void profile(double thickness, double q, std::span<const double> theta_rad, std::span<double> value,
                       std::span<double> d_ln_thickness, std::span<double> d_q) const = 0;
  virtual double min_thickness() const = 0;
  virtual double max_thickness() const = 0;
  virtual double max_q() const = 0;
};

// The camera's point spread, per pixel, as a function of the angle from the lamp; sums to 1 over the
// picture's pixels.
struct PointSpread {
  std::vector<double> theta_rad;   // nodes, increasing, log-spaced
  std::vector<double> ln_density;  // ln of the fraction of the light per pixel
  double core_theta_rad = 0;       // the disc within which everything counts as core
  double core_fraction = 1;        // of the light, within the disc
  double relative_sigma = 0.02;    // its usual deviation from lamp to lamp
  double core_ln_sigma = 0.03;  // uncertainty of ln(core + wings over wings): large where cores are saturated
};

struct SceneLamp {
  std::string id;
  double x_px = 0, y_px = 0;
  std::optional<double> distance_m;  // best value even where it is uncertain
  double distance_ln_sigma = 0;      // 0: exact
  double ln_strength = 0;            // of A_j
  double ln_strength_sigma = 0.06;
  double ln_halo = 0;  // of h_j in fog; in other air see luminaire.h. The fit's parameter comes on top ...
  double ln_halo_sigma = 0.05;  // ... and stays so near to 0
  bool catalogued = true;
  bool core_seen = true;  // false: its core was saturated in the reference, A_j is known by its glare alone
  // Guests are lights of one frame alone (cars, lamps newly lit): they have no rings of their own, but their
  // halos lie over the others'. Their beam, gain·A_j e^(−T_j), is what is known of them.
  std::optional<double> ln_beam;
  double ln_beam_sigma = 0;
  double masked_rad = 0;  // within this of a guest the frame's pixels are left out of the rings
  bool guest() const { return ln_beam.has_value(); }
};

// The air and everything else that may differ from the reference, as the fit sees it.
struct Layout {
  explicit Layout(size_t lamp_count) : lamps(lamp_count) {}
  static constexpr size_t ln_sigma = 0, q = 1, ln_gain = 2, ln_kappa = 3, emission = 4, slope_x = 5,
                          slope_y = 6;
  static constexpr size_t common = 7;
  size_t lamps;
  size_t ln_strength(size_t j) const { return common + j; }
  size_t ln_halo(size_t j) const { return common + lamps + j; }
  size_t ln_distance(size_t j) const { return common + 2 * lamps + j; }
  size_t sky(size_t j) const { return common + 3 * lamps + j; }
  size_t size() const { return common + 4 * lamps; }
};

inline constexpr size_t kSceneNodes = 64;
// The angles at which a lamp's halo is known: the same for every scene, log-spaced.
std::span<const double> scene_nodes_rad();

// Everything of the model that does not change from frame to frame.
class Scene {
 public:
  Scene(const Camera& camera, std::vector<SceneLamp> lamps, const PointSpread& spread,
        const photometry::RingMap& map);

  // d − 1 and s − 1 of every ring; 0 if never set.
  struct RingPattern {
    std::vector<double> lens, sky;
  };
  void set_pattern(RingPattern pattern) { pattern_ = std::move(pattern); }
  const RingPattern& pattern() const { return pattern_; }
  double sky_factor(size_t ring, double roof_transmission) const;  // s
  static double roof_transmission(double ln_sigma);  // of the air before what stands before the sky

  // The same with guests after its own lamps. Costs a fraction of making a scene.
  Scene with_guests(std::span<const SceneLamp> guests) const;

  // The same with each own lamp's ln strength changed.
  Scene with_strengths(std::span<const double> ln_change) const;
  // The same with each own lamp's ln halo changed.
  Scene with_halos(std::span<const double> ln_change) const;

  size_t ring_count() const { return rings_; }
  const std::vector<SceneLamp>& lamps() const { return lamps_; }
  int lamp_of_ring(size_t ring) const { return owner_[ring]; }
  double direct(size_t ring, size_t lamp) const { return direct_[ring * lamps_.size() + lamp]; }
  const PointSpread& spread() const { return spread_; }

  // Model of all rings and, if wanted, the Jacobian (ring-major, Layout::size() columns). `lit`: lamps that
  // are off contribute nothing. `sky_unit`: radiance of sky parameter 1.
  struct Output {
    std::vector<double> model;
    std::vector<double> jacobian;
  };
  void evaluate(const HaloModel& halo, std::span<const double> parameters, std::span<const char> lit,
                double sky_unit, Output& output, bool want_jacobian) const;
  // The same for some rings and some parameters alone, in the order of `rings`: column_of[parameter] is its
  // column of `columns` in the Jacobian, or −1.
  struct Wanted {
    std::span<const size_t> rings;
    std::span<const int> column_of;  // empty: no Jacobian
    size_t columns = 0;
  };
  void evaluate(const HaloModel& halo, std::span<const double> parameters, std::span<const char> lit,
                double sky_unit, const Wanted& wanted, Output& output) const;

  // Each lamp's light in each ring alone, rings x lamps.
  std::vector<double> lights(const HaloModel& halo, std::span<const double> parameters,
                             std::span<const char> lit) const;

  // Mean over the ring of a function given at the nodes that goes as 1/θ between them (for the reference's
  // own fit).
  double average(size_t ring, size_t lamp, std::span<const double> at_nodes) const;
  // nodes x nodes, column-major: what one source node gives to all others.
  const std::vector<double>& convolution() const { return convolution_; }

 private:
  struct LampTerms;
  struct Row;
  struct Range {
    std::uint32_t start, count, offset;
  };
  void add_geometry(const SceneLamp& lamp);
  void add_weights(size_t ring, size_t lamp, std::vector<Range>& ranges);
  std::vector<photometry::Direction> open_samples(size_t ring, size_t lamp) const;
  void make_convolution();
  double direct_share(size_t ring, size_t lamp) const;
  LampTerms terms_of(size_t lamp, const HaloModel& halo, std::span<const double> parameters,
                     bool want_jacobian) const;
  void spread_halo(double* terms) const;
  double add_light(size_t ring, const LampTerms& term, double kappa, Row& row) const;

  photometry::AngularScale scale_;
  std::vector<SceneLamp> lamps_;
  PointSpread spread_;
  std::shared_ptr<const std::vector<photometry::Ring>> ring_shapes_;
  size_t rings_ = 0;
  std::vector<int> owner_;
  std::vector<char> is_core_;            // the innermost ring of its lamp
  std::vector<double> ring_x_, ring_y_;  // mean position in half picture widths from the middle
  std::vector<double> emission_shape_;
  std::vector<double> solid_angle_;  // of a pixel at each lamp
  std::vector<photometry::Direction> to_lamp_;
  double axis_pixel_sr_ = 0, core_area_px_ = 0;
  std::vector<Range> ranges_;  // ring-major
  std::vector<double> weights_;
  std::vector<double> convolution_;  // see convolution()
  std::vector<double> direct_;
  RingPattern pattern_;
};

// Where a ring lies in the picture, for the sky's gradient: half picture widths from its middle.
struct SkyPosition {
  double x = 0, y = 0;
};
SkyPosition sky_position(const photometry::Ring& ring, const Camera& camera);

// Interpolates ln density over ln θ; beyond the last node the last slope goes on.
double spread_density(const PointSpread& spread, double theta_rad);

}  // namespace lampglow::inference
