// The halos of a night's lamps: photons counted by Monte Carlo, for every q and optical thickness of the
// night. Never the glow table or an integral that the fit uses: a fit must not be tested on its own model.
#pragma once

#include <cstdint>
#include <functional>
#include <stop_token>
#include <vector>

namespace lampglow::simulation {

// Scattered radiance [1/sr] at angle θ from a lamp, per irradiance that the lamp would give without air.
// Log-log interpolation between the bins of the count; below the innermost bin it goes on as 1/θ. A lamp that
// does not shine evenly has a profile for each of several azimuths round it: 0 is up in the picture, π/2 to
// the right.
class HaloProfile {
 public:
  HaloProfile() = default;  // no light
  HaloProfile(double ln_theta_first, double ln_theta_step, std::vector<double> ln_radiance,
              std::vector<double> relative_error);

  // ln_radiance: one profile after the other, azimuths k·2π/sectors.
  static HaloProfile with_sectors(double ln_theta_first, double ln_theta_step,
                                  std::vector<double> ln_radiance, int sectors);

  double radiance(double ln_theta, double azimuth_rad = 0) const;  // θ in radians, up to π
  double relative_error(double ln_theta) const;                    // of the count, one standard deviation
  bool dark() const { return ln_radiance_.empty(); }
  bool even() const { return sectors_ == 1; }

 private:
  double sector_radiance(double ln_theta, size_t sector) const;

  double ln_theta_first_ = 0, ln_theta_step_ = 1;
  size_t sectors_ = 1;
  std::vector<double> ln_radiance_, relative_error_;
};

struct HaloRun {
  double q = 0;
  double thickness_max = 1;  // the largest optical thickness that is asked of this q
};

class HaloLibrary {
 public:
  // Lamps behind more than this are not drawn: their light is part of the sky's.
  static constexpr double kThickest = 12;

  // Counts photons for each run, in `workers` threads; progress(done, of) is called as they end. After a stop
  // it holds only a part of the runs and is good for nothing.
  HaloLibrary(const std::vector<HaloRun>& runs, std::uint64_t photons, std::uint64_t seed, int workers,
              const std::function<void(int, int)>& progress, const std::stop_token& stop = {});

  // For the run whose q is this one (or the next above it), and T = σR > 0.
  HaloProfile profile(double q, double thickness) const;

  // The q of the runs within [low, high] that reach this optical thickness, ascending.
  std::vector<double> counted_q(double low, double high, double thickness) const;

 private:
  struct Sphere {
    double thickness = 0;
    std::vector<double> ln_radiance, relative_error;
  };
  struct Count {
    double q = 0;
    std::vector<Sphere> spheres;
  };
  static Count count_photons(const HaloRun& run, std::uint64_t photons, std::uint64_t seed);
  HaloProfile at_thickness(const Count& count, double thickness) const;

  std::vector<Count> counts_;  // ascending q
};

}  // namespace lampglow::simulation
