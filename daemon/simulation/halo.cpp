#include "daemon/simulation/halo.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <numbers>

#include "daemon/simulation/parallel.h"
#include "estimator/scattering/monte_carlo.h"

namespace lampglow::simulation {

namespace {

constexpr double kFirstDeg = 0.06;
constexpr double kLastDeg = 180;
constexpr size_t kAngleBins = 70;  // 20 a decade
constexpr double kThinnest = 0.005;
constexpr double kSpheresPerFactorE = 10;

std::vector<double> counting_spheres(double thickness_max) {
  const double last = std::clamp(thickness_max * 1.05, 0.1, HaloLibrary::kThickest * 1.05);
  const int count = 2 + static_cast<int>(kSpheresPerFactorE * std::log(last / kThinnest));
  std::vector<double> spheres;
  spheres.reserve(static_cast<size_t>(count));
  for (int i = 0; i < count; ++i)
    spheres.push_back(kThinnest * std::pow(last / kThinnest, i / (count - 1.0)));
  return spheres;
}

// Empty bins (far behind a forward-peaked lamp) take their neighbour's value.
void fill_empty_bins(std::vector<double>& ln_radiance) {
  const double empty = -std::numeric_limits<double>::infinity();
  for (size_t i = 1; i < ln_radiance.size(); ++i) {
    if (ln_radiance[i] == empty) ln_radiance[i] = ln_radiance[i - 1];
  }
  for (size_t i = ln_radiance.size() - 1; i-- > 0;) {
    if (ln_radiance[i] == empty) ln_radiance[i] = ln_radiance[i + 1];
  }
}

// One pass of (1, 2, 1)/4, the ends kept: takes the count's scatter from bin to bin, not the shape.
void smooth_lightly(std::vector<double>& values) {
  const std::vector<double> raw = values;
  for (size_t i = 1; i + 1 < raw.size(); ++i)
    values[i] = 0.25 * raw[i - 1] + 0.5 * raw[i] + 0.25 * raw[i + 1];
}

double mix(double a, double b, double share) {
  return a + (b - a) * share;
}

std::vector<double> mix(const std::vector<double>& a, const std::vector<double>& b, double share) {
  std::vector<double> mixed(a.size());
  for (size_t i = 0; i < a.size(); ++i) mixed[i] = mix(a[i], b[i], share);
  return mixed;
}

constexpr double kLnStep = 8.006367567650246 / 70;  // ln(180/0.06) / bins

// Mean radiance over a bin stands at the bin's arithmetic middle: exact for the 1/θ cusp.
double ln_theta_of_first_bin() {
  return std::log(kFirstDeg * std::numbers::pi / 180 * 0.5 * (1 + std::exp(kLnStep)));
}

}  // namespace

HaloProfile::HaloProfile(double ln_theta_first, double ln_theta_step, std::vector<double> ln_radiance,
                         std::vector<double> relative_error)
    : ln_theta_first_(ln_theta_first),
      ln_theta_step_(ln_theta_step),
      ln_radiance_(std::move(ln_radiance)),
      relative_error_(std::move(relative_error)) {}

HaloProfile HaloProfile::with_sectors(double ln_theta_first, double ln_theta_step,
                                      std::vector<double> ln_radiance, int sectors) {
  HaloProfile profile(ln_theta_first, ln_theta_step, std::move(ln_radiance), {});
  profile.sectors_ = static_cast<size_t>(sectors);
  return profile;
}

double HaloProfile::sector_radiance(double ln_theta, size_t sector) const {
  const size_t bins = ln_radiance_.size() / sectors_;
  const double* values = &ln_radiance_[sector * bins];
  const double position = (ln_theta - ln_theta_first_) / ln_theta_step_;
  if (position <= 0) return std::exp(values[0] - (ln_theta - ln_theta_first_));
  const auto bin = std::min(static_cast<size_t>(position), bins - 2);
  const double share = std::min(position - static_cast<double>(bin), 1.0);
  return std::exp(mix(values[bin], values[bin + 1], share));
}

double HaloProfile::radiance(double ln_theta, double azimuth_rad) const {
  if (dark()) return 0;
  if (sectors_ == 1) return sector_radiance(ln_theta, 0);
  const double turn = azimuth_rad / (2 * std::numbers::pi);
  const double position = (turn - std::floor(turn)) * static_cast<double>(sectors_);
  const auto sector = static_cast<size_t>(position) % sectors_;
  return mix(sector_radiance(ln_theta, sector), sector_radiance(ln_theta, (sector + 1) % sectors_),
             position - std::floor(position));
}

double HaloProfile::relative_error(double ln_theta) const {
  if (relative_error_.empty()) return 0;
  const double position = (ln_theta - ln_theta_first_) / ln_theta_step_;
  const double last = static_cast<double>(relative_error_.size() - 1);
  return relative_error_[static_cast<size_t>(std::clamp(position, 0.0, last))];
}

HaloLibrary::Count HaloLibrary::count_photons(const HaloRun& run, std::uint64_t photons, std::uint64_t seed) {
  scattering::GlowPhotons glow;
  glow.q = run.q;
  glow.thicknesses = counting_spheres(run.thickness_max);
  glow.theta_edges_rad = scattering::log_spaced_edges_rad(kFirstDeg, kLastDeg, kAngleBins);
  glow.photons = photons;
  glow.seed = seed;
  const scattering::GlowEstimate counted = scattering::simulate_glow(glow);
  Count result{run.q, {}};
  for (size_t t = 0; t < glow.thicknesses.size(); ++t) {
    const double thickness = glow.thicknesses[t];
    // From optical units per flux to "per irradiance without air", Φ/(4πR²).
    const double scale = 4 * std::numbers::pi * thickness * thickness;
    Sphere sphere{thickness, {}, {}};
    for (size_t b = 0; b < kAngleBins; ++b) {
      const scattering::Estimate bin = counted.total(0, t, b);
      sphere.ln_radiance.push_back(std::log(bin.value * scale));
      sphere.relative_error.push_back(bin.value > 0 ? bin.sigma / bin.value : 1);
    }
    fill_empty_bins(sphere.ln_radiance);
    smooth_lightly(sphere.ln_radiance);
    result.spheres.push_back(std::move(sphere));
  }
  return result;
}

HaloLibrary::HaloLibrary(const std::vector<HaloRun>& runs, std::uint64_t photons, std::uint64_t seed,
                         int workers, const std::function<void(int, int)>& progress,
                         const std::stop_token& stop)
    : counts_(runs.size()) {
  int done = 0;
  std::mutex mutex;
  for_each_index(
      static_cast<int>(runs.size()), workers,
      [&](int i) {
        const auto run = static_cast<size_t>(i);
        counts_[run] = count_photons(runs[run], photons, seed * 1000 + run);
        const std::lock_guard lock(mutex);
        progress(++done, static_cast<int>(runs.size()));
      },
      stop);
  std::sort(counts_.begin(), counts_.end(), [](const Count& a, const Count& b) { return a.q < b.q; });
}

// Below the thinnest sphere a halo is proportional to the air in it; above the thickest none is drawn.
HaloProfile HaloLibrary::at_thickness(const Count& count, double thickness) const {
  const std::vector<Sphere>& spheres = count.spheres;
  const double first = ln_theta_of_first_bin();
  if (thickness > spheres.back().thickness) return {};
  const double step = std::log(spheres[1].thickness / spheres[0].thickness);
  const double position = std::log(thickness / spheres[0].thickness) / step;
  if (position <= 0) {
    std::vector<double> ln_radiance = spheres[0].ln_radiance;
    for (double& value : ln_radiance) value += position * step;
    return {first, kLnStep, std::move(ln_radiance), spheres[0].relative_error};
  }
  const size_t below = std::min(static_cast<size_t>(position), spheres.size() - 2);
  const double share = position - static_cast<double>(below);
  return {first, kLnStep, mix(spheres[below].ln_radiance, spheres[below + 1].ln_radiance, share),
          mix(spheres[below].relative_error, spheres[below + 1].relative_error, share)};
}

std::vector<double> HaloLibrary::counted_q(double low, double high, double thickness) const {
  std::vector<double> found;
  for (const Count& count : counts_) {
    const bool reaches = thickness <= count.spheres.back().thickness;
    if (reaches && count.q >= low && count.q <= high) found.push_back(count.q);
  }
  return found;
}

HaloProfile HaloLibrary::profile(double q, double thickness) const {
  auto above = std::find_if(counts_.begin(), counts_.end(), [&](const Count& c) { return c.q >= q - 1e-12; });
  if (above == counts_.end()) --above;
  return at_thickness(*above, thickness);
}

}  // namespace lampglow::simulation
