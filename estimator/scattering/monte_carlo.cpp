#include "estimator/scattering/monte_carlo.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "estimator/scattering/far_field.h"
#include "estimator/scattering/random.h"

namespace lampglow::scattering {
namespace {

// Finds the bin of sin θ in constant time: a table over the leading bits of the float, then a step or two.
class SineBins {
 public:
  static constexpr int kNone = -1;

  // Ascending sines in [0, 1]; bins[i] is the caller's bin between sines[i] and sines[i+1].
  SineBins(std::vector<float> sines, std::vector<int> bins)
      : sines_(std::move(sines)), bins_(std::move(bins)) {
    for (std::uint32_t key = 0; key < start_.size(); ++key) {
      const float lowest = std::bit_cast<float>(key << kShift);
      std::size_t i = 0;
      while (i < bins_.size() && sines_[i + 1] <= lowest) ++i;
      start_[key] = static_cast<int>(i);
    }
  }

  int find(float sine) const {
    if (bins_.empty() || !(sine >= sines_.front()) || sine >= sines_.back()) return kNone;
    auto i = static_cast<std::size_t>(start_[std::bit_cast<std::uint32_t>(sine) >> kShift]);
    while (sines_[i + 1] <= sine) ++i;
    return bins_[i];
  }

 private:
  static constexpr int kShift = 19;  // exponent and four bits of mantissa
  std::vector<float> sines_;
  std::vector<int> bins_;
  std::vector<int> start_ = std::vector<int>((0x3f800000u >> kShift) + 1);
};

// θ <= 90° is light that moves outward across the sphere, θ > 90° inward; sin θ is the same for both.
SineBins outward_bins(const std::vector<double>& edges) {
  std::vector<float> sines;
  std::vector<int> bins;
  for (std::size_t b = 0; b < edges.size() && edges[b] < std::numbers::pi / 2; ++b) {
    sines.push_back(static_cast<float>(std::sin(edges[b])));
    if (b + 1 == edges.size()) break;
    bins.push_back(static_cast<int>(b));
    if (edges[b + 1] >= std::numbers::pi / 2) sines.push_back(1.0f);
  }
  return {sines, bins};
}

SineBins inward_bins(const std::vector<double>& edges) {
  std::vector<float> sines;
  std::vector<int> bins;
  for (std::size_t b = edges.size(); b-- > 0 && edges[b] > std::numbers::pi / 2;) {
    sines.push_back(static_cast<float>(std::sin(edges[b])));
    if (b == 0) break;
    bins.push_back(static_cast<int>(b) - 1);
    if (edges[b - 1] <= std::numbers::pi / 2) sines.push_back(1.0f);
  }
  return {sines, bins};
}

// Sums of weight/|cos θ| of one block of photons.
struct Tally {
  std::vector<double> single, multiple;
};

// -sin(π(u - 1/2)) = cos(πu) for u in (0, 1), to 1e-7: the cosine of a uniform azimuth.
float cos_half_turn(float u) {
  const float y = u - 0.5f;
  const float y2 = y * y;
  const float poly =
      3.14159265f +
      y2 * (-5.16771278f + y2 * (2.55016404f + y2 * (-0.59926453f + y2 * (0.08214589f - y2 * 0.00737043f))));
  return -y * poly;
}

// Where a photon is and where it flies to: the radius and the angle to the outward radius. By symmetry
// nothing else matters. The sine is kept beside the cosine because small angles are what we are after.
struct Photon {
  float radius, cosine, sine;
};

class BlockRun {
 public:
  BlockRun(const GlowPhotons& run, const SineBins& outward, const SineBins& inward, std::size_t block)
      : run_(run),
        outward_(outward),
        inward_(inward),
        random_(run.seed, block),
        radii_(run.thicknesses.begin(), run.thicknesses.end()),
        albedos_(run.albedos.begin(), run.albedos.end()),
        weights_(run.albedos.size()),
        bins_(run.theta_edges_rad.size() - 1),
        q_(static_cast<float>(run.q)),
        far_(run.black_radius.value_or(run.thicknesses.back() + run.far_margin / (1 - run.q)), run.q),
        far_radius_(static_cast<float>(far_.radius())) {
    const std::size_t size = run.albedos.size() * radii_.size() * bins_;
    tally_.single.assign(size, 0);
    tally_.multiple.assign(size, 0);
    lossless_ = std::all_of(albedos_.begin(), albedos_.end(), [](float albedo) { return albedo == 1; });
  }

  Tally run(std::uint64_t photons) {
    for (std::uint64_t i = 0; i < photons; ++i) trace();
    return std::move(tally_);
  }

 private:
  void trace() {
    std::fill(weights_.begin(), weights_.end(), 1.0f);
    target_ = &tally_.single;
    // The unscattered flight from the lamp is the direct beam: not counted.
    Photon photon{-std::log(random_.two_uniforms()[0]), 1, 0};
    for (bool first = true; absorb(); first = false) {
      if (photon.radius > far_radius_ && !return_from_far(photon)) return;
      if (!returned_) scatter(photon);
      returned_ = false;
      if (!first) target_ = &tally_.multiple;
      fly(photon);
    }
  }

  // One scattering's loss, and Russian roulette for photons that hardly count any more. False: the photon
  // ends.
  bool absorb() {
    if (lossless_) return true;
    float largest = 0;
    for (std::size_t a = 0; a < weights_.size(); ++a) {
      weights_[a] *= albedos_[a];
      largest = std::max(largest, weights_[a]);
    }
    if (largest > 0.01f) return true;
    if (random_.uniform() < 0.5) return false;
    for (float& weight : weights_) weight *= 2;
    return true;
  }

  // The new direction, in the frame of the outward radius. With w uniform, Henyey-Greenstein's inverse
  // cumulative is 1 - cos α = (1-q) w (f + 1 - q) / (1 + q - 2qw), f = (1-q²)/(1 + q - 2qw): nothing cancels
  // at small α.
  void scatter(Photon& photon) {
    const auto [w, u] = random_.two_uniforms();
    const float inverse = 1 / (1 + q_ - 2 * q_ * w);
    const float fraction = (1 - q_) * (1 + q_) * inverse;
    const float one_minus_cos = (1 - q_) * w * (fraction + 1 - q_) * inverse;
    const float cos_alpha = 1 - one_minus_cos;
    const float sin_squared = one_minus_cos * (2 - one_minus_cos);
    const float azimuth = cos_half_turn(u);
    const float in_plane = std::sqrt(sin_squared) * azimuth;
    const float across_squared = sin_squared * (1 - azimuth * azimuth);
    const float sine_in_plane = cos_alpha * photon.sine + in_plane * photon.cosine;
    photon.cosine = cos_alpha * photon.cosine - in_plane * photon.sine;
    photon.sine = std::sqrt(sine_in_plane * sine_in_plane + std::abs(across_squared));
  }

  // A straight flight: a line that passes the lamp at distance `miss`, from x0 to x1 along it.
  void fly(Photon& photon) {
    const float length = -std::log(random_.two_uniforms()[0]);
    const float x0 = photon.radius * photon.cosine;
    const float x1 = x0 + length;
    const float miss = photon.radius * photon.sine;
    const float end_radius = std::sqrt(x1 * x1 + miss * miss);
    if (x0 < 0) count(inward_, miss, x1 < 0 ? end_radius : miss, photon.radius);
    if (x1 > 0) count(outward_, miss, x0 > 0 ? photon.radius : miss, end_radius);
    const float inverse = 1 / end_radius;
    photon = {end_radius, x1 * inverse, miss * inverse};
  }

  // Counts the crossings of all spheres with radii between lower and upper.
  void count(const SineBins& bins, float miss, float lower, float upper) {
    if (lower >= radii_.back() || upper <= radii_.front()) return;
    for (std::size_t t = 0; t < radii_.size() && radii_[t] < upper; ++t) {
      const float radius = radii_[t];
      if (radius <= lower) continue;
      const int bin = bins.find(miss / radius);
      if (bin == SineBins::kNone) continue;
      const float score = radius / std::sqrt((radius - miss) * (radius + miss));
      std::size_t slot = t * bins_ + static_cast<std::size_t>(bin);
      for (const float weight : weights_) {
        (*target_)[slot] += static_cast<double>(weight * score);
        slot += radii_.size() * bins_;
      }
    }
  }

  bool return_from_far(Photon& photon) {
    if (run_.black_radius) return false;
    const auto from = static_cast<double>(photon.radius), cosine = static_cast<double>(photon.cosine);
    if (!far_.comes_back(from, cosine, random_)) return false;
    if (!lossless_) {
      const double scatterings = far_.scatterings(from, cosine, random_);
      for (std::size_t a = 0; a < weights_.size(); ++a)
        weights_[a] *= static_cast<float>(std::pow(static_cast<double>(albedos_[a]), scatterings));
    }
    const auto inward = static_cast<float>(FarField::inward_cosine(random_));
    photon = {far_radius_, -inward, std::sqrt((1 - inward) * (1 + inward))};
    returned_ = true;
    return true;
  }

  const GlowPhotons& run_;
  const SineBins& outward_;
  const SineBins& inward_;
  Random random_;
  std::vector<float> radii_, albedos_, weights_;
  std::size_t bins_;
  float q_;
  FarField far_;
  float far_radius_;
  bool lossless_ = false;
  bool returned_ = false;
  Tally tally_;
  std::vector<double>* target_ = nullptr;
};

void refuse(const std::string& what) {
  throw std::invalid_argument("Monte Carlo: " + what);
}

void check(const GlowPhotons& run) {
  if (!(std::abs(run.q) <= 0.99)) refuse("q = " + std::to_string(run.q) + ", must be within -0.99..0.99");
  if (run.albedos.empty() ||
      std::any_of(run.albedos.begin(), run.albedos.end(), [](double a) { return !(a > 0 && a <= 1); }))
    refuse("albedos must be one or more numbers in (0, 1]");
  if (run.thicknesses.empty() || !(run.thicknesses.front() > 0) ||
      !std::is_sorted(run.thicknesses.begin(), run.thicknesses.end()))
    refuse("thicknesses must be positive and ascending");
  if (run.theta_edges_rad.size() < 2 || !(run.theta_edges_rad.front() >= 0) ||
      !(run.theta_edges_rad.back() <= std::numbers::pi + 1e-12) ||
      !std::is_sorted(run.theta_edges_rad.begin(), run.theta_edges_rad.end()))
    refuse("theta_edges_rad must be two or more ascending angles within 0..π");
  if (run.photons == 0) refuse("photons must be positive");
  if (!(run.far_margin >= 1)) refuse("far_margin must be at least 1");
  if (run.black_radius && !(*run.black_radius > run.thicknesses.back()))
    refuse("black_radius must be larger than the largest thickness");
}

// Mean and its standard deviation from the blocks' sums.
Estimate from_blocks(const std::vector<double>& sums, double scale) {
  const auto count = static_cast<double>(sums.size());
  double mean = 0, squares = 0;
  for (const double sum : sums) mean += sum / count;
  for (const double sum : sums) squares += (sum - mean) * (sum - mean);
  return {mean * scale, std::sqrt(squares / (count * (count - 1))) * scale};
}

}  // namespace

Estimate GlowEstimate::single(std::size_t albedo, std::size_t thickness, std::size_t bin) const {
  return single_.at(index(albedo, thickness, bin));
}

Estimate GlowEstimate::multiple(std::size_t albedo, std::size_t thickness, std::size_t bin) const {
  return multiple_.at(index(albedo, thickness, bin));
}

Estimate GlowEstimate::total(std::size_t albedo, std::size_t thickness, std::size_t bin) const {
  return total_.at(index(albedo, thickness, bin));
}

GlowEstimate simulate_glow(const GlowPhotons& run, const Executor& executor) {
  check(run);
  const SineBins outward = outward_bins(run.theta_edges_rad), inward = inward_bins(run.theta_edges_rad);
  const std::uint64_t per_block = (run.photons + kPhotonBlocks - 1) / kPhotonBlocks;
  std::vector<Tally> tallies(kPhotonBlocks);
  executor(kPhotonBlocks,
           [&](std::size_t block) { tallies[block] = BlockRun(run, outward, inward, block).run(per_block); });

  GlowEstimate result;
  result.thicknesses_ = run.thicknesses.size();
  result.bins_ = run.theta_edges_rad.size() - 1;
  result.photons_ = per_block * kPhotonBlocks;
  std::vector<double> single(kPhotonBlocks), multiple(kPhotonBlocks), total(kPhotonBlocks);
  for (std::size_t a = 0; a < run.albedos.size(); ++a)
    for (std::size_t t = 0; t < run.thicknesses.size(); ++t)
      for (std::size_t b = 0; b < result.bins_; ++b) {
        const std::size_t slot = result.index(a, t, b);
        for (std::size_t k = 0; k < kPhotonBlocks; ++k) {
          single[k] = tallies[k].single[slot];
          multiple[k] = tallies[k].multiple[slot];
          total[k] = single[k] + multiple[k];
        }
        const double area = 4 * std::numbers::pi * run.thicknesses[t] * run.thicknesses[t];
        const double scale = 1 / (static_cast<double>(per_block) * area *
                                  ring_solid_angle_sr(run.theta_edges_rad[b], run.theta_edges_rad[b + 1]));
        result.single_.push_back(from_blocks(single, scale));
        result.multiple_.push_back(from_blocks(multiple, scale));
        result.total_.push_back(from_blocks(total, scale));
      }
  return result;
}

std::vector<double> log_spaced_edges_rad(double first_deg, double last_deg, std::size_t count) {
  std::vector<double> edges(count + 1);
  const double step = std::log(last_deg / first_deg) / static_cast<double>(count);
  for (std::size_t i = 0; i <= count; ++i)
    edges[i] = first_deg * std::exp(step * static_cast<double>(i)) * std::numbers::pi / 180;
  edges.back() = last_deg * std::numbers::pi / 180;
  return edges;
}

double ring_solid_angle_sr(double inner_rad, double outer_rad) {
  return 4 * std::numbers::pi * std::sin((outer_rad - inner_rad) / 2) * std::sin((outer_rad + inner_rad) / 2);
}

}  // namespace lampglow::scattering
