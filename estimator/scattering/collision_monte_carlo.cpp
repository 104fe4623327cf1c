#include "estimator/scattering/collision_monte_carlo.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>

#include "estimator/scattering/far_field.h"
#include "estimator/scattering/phase_function.h"
#include "estimator/scattering/random.h"

namespace lampglow::scattering {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::size_t kBatches = 16;  // of one round; each has a random stream of its own
constexpr int kMinRounds = 4;
// Optical depth beyond the direct beam's from which nothing is seen any more.
constexpr double kDark = 25;
// Farther out a photon that was drawn more often than it is found is one among others again.
constexpr double kAfar = 1;
// A collision so far outside of the camera's sphere is not counted: the far field begins here at the
// earliest.
constexpr double kUnseen = 10;

struct Photon {
  double radius, cosine, sine;  // place, and the angle between its flight and the outward radius
  double weight;
  double start_weight;  // what it was given where rare ways are drawn more often than they are taken
  int scatterings;      // collisions so far, the present one included
  bool on_the_way;      // crosses the far sphere: to be moved, not scattered
};

// A straight way past the lamp at distance `miss`, from x = begin on; x = 0 is nearest to the lamp.
struct Flight {
  double begin, miss, first;

  explicit Flight(const Photon& photon)
      : begin(photon.radius * photon.cosine),
        miss(photon.radius * photon.sine),
        first(std::atan2(begin, miss)) {}
  // Probability density of x when angles seen from the lamp are equally likely.
  double per_unit(double x) const { return miss / ((kPi / 2 - first) * (miss * miss + x * x)); }
};

// Complete elliptic integral of the second kind by its complementary parameter m1 = 1 - m, to 2e-8
// (Abramowitz and Stegun 17.3.36).
double elliptic_e(double m1) {
  const double a =
      1 + m1 * (0.44325141463 + m1 * (0.06260601220 + m1 * (0.04757383546 + m1 * 0.01736506451)));
  const double b = m1 * (0.24998368310 + m1 * (0.09200180037 + m1 * (0.04069697526 + m1 * 0.00526449639)));
  return a - b * std::log(m1);
}

// One ring's sums.
struct Sum {
  double single = 0, multiple = 0;
};

class Batch {
 public:
  Batch(const CollisionPhotons& run, std::uint64_t stream)
      : run_(run),
        phase_(run.q),
        far_(run.thickness + std::max(run.far_margin / (1 - run.q), kUnseen), run.q),
        random_(run.seed, stream),
        decay_(std::min(0.9, std::sqrt(3 * (1 - run.albedo) * (1 - run.albedo * run.q)))),
        sums_(run.rings.size()) {}

  std::vector<Sum> run(std::uint64_t photons) {
    for (std::uint64_t i = 0; i < photons; ++i) {
      waiting_.push_back({0, 1, 0, 1, 1, 0, true});
      while (!waiting_.empty()) {
        Photon photon = waiting_.back();
        waiting_.pop_back();
        follow(photon);
      }
    }
    return std::move(sums_);
  }

 private:
  void follow(Photon& photon) {
    for (;;) {
      if (!photon.on_the_way) scatter(photon);
      const Flight flight(photon);
      if (flight.miss > 0) score_near_the_lamp(photon, flight);
      const double length = photon.radius == 0 ? first_flight(photon) : -std::log(random_.open_uniform());
      move(photon, flight, flight.begin + length);
      if (photon.radius > far_.radius()) {
        if (!return_from_far(photon)) return;
        continue;
      }
      score(photon,
            flight.miss > 0 ? 1 / (1 + flight.per_unit(flight.begin + length) * std::exp(length)) : 1);
      if (!in_window(photon)) return;
    }
  }

  // The way from the lamp to the first collision. In thin air few photons collide between lamp and camera,
  // but those make most of the light that is scattered twice: half of the ways are drawn on that scale, from
  // T/(T + r)², and the weight makes up for it.
  double first_flight(Photon& photon) {
    const double u = random_.open_uniform();
    if (run_.thickness >= 1) return -std::log(u);
    const double scale = run_.thickness;
    const double length = random_.uniform() < 0.5 ? -std::log(u) : scale * (1 - u) / u;
    const double natural = std::exp(-length),
                 drawn = (natural + scale / ((scale + length) * (scale + length))) / 2;
    photon.start_weight = natural / drawn;
    photon.weight *= photon.start_weight;
    return length;
  }

  // A collision at x along the flight.
  void move(Photon& photon, const Flight& flight, double x) const {
    photon.radius = std::sqrt(x * x + flight.miss * flight.miss);
    photon.cosine = x / photon.radius;
    photon.sine = flight.miss / photon.radius;
    photon.on_the_way = false;
    ++photon.scatterings;
    photon.weight *= run_.albedo;
  }

  // Collisions near the lamp are rare in thin air and count as 1/r²: each flight has one more there, drawn
  // evenly in the angle seen from the lamp. It and the natural one share by the balance heuristic (Veach and
  // Guibas 1995).
  void score_near_the_lamp(const Photon& photon, const Flight& flight) {
    const double x = flight.miss * std::tan(flight.first + (kPi / 2 - flight.first) * random_.open_uniform());
    if (!(x > flight.begin)) return;
    Photon collision = photon;
    move(collision, flight, x);
    if (collision.radius > far_.radius()) return;
    const double natural = std::exp(flight.begin - x);
    score(collision, natural / (natural + flight.per_unit(x)));
  }

  // In thin air light that turns sharply at one of its first collisions and slightly at another makes much of
  // what is seen far from the lamp, and such photons are rare: half of the turns are drawn from all
  // directions.
  double draw_turn(Photon& photon) {
    if (run_.thickness >= 1 || photon.scatterings > 2 || photon.radius > kAfar)
      return phase_.sample(random_.uniform());
    const double u = random_.uniform();
    const double cos_alpha = random_.uniform() < 0.5 ? phase_.sample(u) : 2 * u - 1;
    const double natural = 4 * kPi * phase_.per_sr(cos_alpha), factor = 2 * natural / (natural + 1);
    photon.start_weight *= factor;
    photon.weight *= factor;
    return cos_alpha;
  }

  void scatter(Photon& photon) {
    const double cos_alpha = draw_turn(photon);
    const double sin_alpha = std::sqrt(std::max(0.0, (1 - cos_alpha) * (1 + cos_alpha)));
    const double turn = 2 * kPi * random_.uniform();
    const double in_plane = sin_alpha * std::cos(turn), across = sin_alpha * std::sin(turn);
    const double sine = photon.sine * cos_alpha + photon.cosine * in_plane;
    photon.cosine = photon.cosine * cos_alpha - photon.sine * in_plane;
    photon.sine = std::sqrt(sine * sine + across * across);
  }

  // Splits a photon whose weight is large for where it is, and ends most of those that hardly count. What a
  // photon is worth falls with the distance from the camera's sphere as diffused light does.
  bool in_window(Photon& photon) {
    if (photon.radius > kAfar) photon.start_weight = 1;
    const double outside = photon.radius - run_.thickness;
    const double expected =
        photon.start_weight *
        std::exp(decay_ * (std::max(outside, 0.0) - std::min(photon.radius, run_.thickness)));
    if (photon.weight > 2 * expected) {
      const auto copies = static_cast<std::size_t>(photon.weight / expected);
      photon.weight /= static_cast<double>(copies);
      waiting_.insert(waiting_.end(), copies - 1, photon);
    } else if (photon.weight < expected / 2) {
      if (random_.uniform() * expected > photon.weight) return false;
      photon.weight = expected;
    }
    return true;
  }

  bool return_from_far(Photon& photon) {
    if (!far_.comes_back(photon.radius, photon.cosine, random_)) return false;
    if (run_.albedo < 1)
      photon.weight *= std::pow(run_.albedo, far_.scatterings(photon.radius, photon.cosine, random_));
    const double inward = FarField::inward_cosine(random_);
    photon.radius = far_.radius();
    photon.cosine = -inward;
    photon.sine = std::sqrt((1 - inward) * (1 + inward));
    photon.scatterings += 2;  // of higher order in any case
    photon.on_the_way = true;
    return photon.weight > 0;
  }

  // p(α) averaged over the turn of one of two directions at these angles to the radius. With A and B of 1 +
  // q² - 2q cos α = A - B cos φ the mean of (A - B cos φ)^(-3/2) is 2 E(m)/(π (A - B) sqrt(A + B)), m = 2B/(A
  // + B).
  double mean_phase(double cosine, double sine, double ray_cosine, double ray_sine) const {
    const double q = run_.q, along = cosine * ray_cosine, across = sine * ray_sine;
    const double least = (1 - q) * (1 - q) + 2 * q * std::max(0.0, 1 - along - across);
    const double most = least + 4 * q * across;
    return (1 - q * q) / (2 * kPi * kPi) * elliptic_e(least / most) / (least * std::sqrt(most));
  }

  // A ray through a collision, by its angles at the camera and at the collision: r sin χ = T sin θ.
  struct Ray {
    double sin_theta, cos_theta, sin_chi, cos_chi;
    double measure;  // of sin θ dθ / cos χ; 0 if the collision lies on no ray of the ring
  };

  // Beyond the camera's sphere drawn evenly in θ, within it evenly in χ: the one avoids what grows without
  // bound where θ nears 90°, the other where χ does.
  Ray draw_ray(const Ring& ring, double radius) {
    const double ratio = run_.thickness / radius;
    Ray ray{};
    if (ratio < 1) {
      const double theta = ring.inner_rad + (ring.outer_rad - ring.inner_rad) * random_.uniform();
      ray.sin_theta = std::sin(theta);
      ray.cos_theta = std::cos(theta);
      ray.sin_chi = ratio * ray.sin_theta;
      ray.cos_chi = std::sqrt(1 - ray.sin_chi * ray.sin_chi);
      ray.measure = (ring.outer_rad - ring.inner_rad) * ray.sin_theta / ray.cos_chi;
      return ray;
    }
    const double nearest = ratio * std::sin(ring.inner_rad), farthest = ratio * std::sin(ring.outer_rad);
    if (nearest >= 1) return ray;
    const double first = std::asin(nearest), last = farthest < 1 ? std::asin(farthest) : kPi / 2;
    const double chi = first + (last - first) * random_.uniform();
    ray.sin_chi = std::sin(chi);
    ray.cos_chi = std::cos(chi);
    ray.sin_theta = ray.sin_chi / ratio;
    ray.cos_theta = std::sqrt(std::max(0.0, 1 - ray.sin_theta * ray.sin_theta));
    if (ray.cos_theta > 0) ray.measure = (last - first) * ray.sin_theta / (ratio * ray.cos_theta);
    return ray;
  }

  // What this collision, of this share, sends to the camera within each ring: the header's formula, its mean
  // over the ring of solid angle Ω being ∫ sin θ dθ / (2 r² cos χ Ω) Σ± e^(-s±) p(α±).
  void score(const Photon& photon, double share) {
    const double thickness = run_.thickness, radius = photon.radius;
    for (std::size_t i = 0; i < sums_.size(); ++i) {
      const Ring& ring = run_.rings[i];
      const Ray ray = draw_ray(ring, radius);
      if (ray.measure == 0) continue;
      const double to_foot = thickness * ray.cos_theta, from_foot = radius * ray.cos_chi;
      if (from_foot >= to_foot && from_foot + to_foot > thickness + kDark) continue;
      double light =
          std::exp(-to_foot - from_foot) * mean_phase(photon.cosine, photon.sine, -ray.cos_chi, ray.sin_chi);
      if (from_foot < to_foot)
        light +=
            std::exp(from_foot - to_foot) * mean_phase(photon.cosine, photon.sine, ray.cos_chi, ray.sin_chi);
      light *= photon.weight * share * ray.measure /
               (2 * radius * radius * ring_solid_angle_sr(ring.inner_rad, ring.outer_rad));
      (photon.scatterings == 1 ? sums_[i].single : sums_[i].multiple) += light;
    }
  }

  const CollisionPhotons& run_;
  HenyeyGreenstein phase_;
  FarField far_;
  Random random_;
  double decay_;
  std::vector<Photon> waiting_;
  std::vector<Sum> sums_;
};

void check(const CollisionPhotons& run) {
  const auto refuse = [](const std::string& what) {
    throw std::invalid_argument("collision Monte Carlo: " + what);
  };
  if (!(run.q >= 0 && run.q <= 0.98)) refuse("q = " + std::to_string(run.q) + ", must be within 0..0.98");
  if (!(run.albedo > 0 && run.albedo <= 1)) refuse("albedo must be above 0 and at most 1");
  if (!(run.thickness > 0)) refuse("thickness must be positive");
  if (run.rings.empty()) refuse("rings must not be empty");
  for (const Ring& ring : run.rings)
    if (!(ring.inner_rad > 0 && ring.inner_rad < ring.outer_rad && ring.outer_rad <= kPi / 2))
      refuse("a ring must lie within 0..pi/2, inner below outer");
  if (run.photons_per_round < kBatches || run.max_rounds < kMinRounds)
    refuse("photons_per_round must be at least 16 and max_rounds at least 4");
  if (!(run.far_margin >= 1)) refuse("far_margin must be at least 1");
}

Estimate mean_of(const std::vector<std::vector<Sum>>& batches, std::size_t ring, double Sum::*part) {
  const auto count = static_cast<double>(batches.size());
  double mean = 0, squares = 0;
  for (const auto& batch : batches) mean += batch[ring].*part / count;
  for (const auto& batch : batches) squares += std::pow(batch[ring].*part - mean, 2);
  return {mean, std::sqrt(squares / (count * (count - 1)))};
}

}  // namespace

CollisionEstimate simulate_collisions(const CollisionPhotons& run, const Executor& executor) {
  check(run);
  const std::uint64_t per_batch = (run.photons_per_round + kBatches - 1) / kBatches;
  std::vector<std::vector<Sum>> batches;
  CollisionEstimate result;
  for (int round = 1; round <= run.max_rounds; ++round) {
    const std::size_t done = batches.size();
    batches.resize(done + kBatches);
    executor(kBatches, [&](std::size_t i) {
      batches[done + i] = Batch(run, done + i).run(per_batch);
      for (Sum& sum : batches[done + i]) {
        sum.single /= static_cast<double>(per_batch);
        sum.multiple /= static_cast<double>(per_batch);
      }
    });
    if (round < kMinRounds) continue;
    result = {};
    bool known = true;
    for (std::size_t i = 0; i < run.rings.size(); ++i) {
      const Estimate single = result.single.emplace_back(mean_of(batches, i, &Sum::single));
      const Estimate multiple = result.multiple.emplace_back(mean_of(batches, i, &Sum::multiple));
      known = known && multiple.sigma <= run.relative_error * (single.value + multiple.value) &&
              multiple.sigma <= run.relative_error_of_multiple * multiple.value;
    }
    if (known) break;
  }
  result.photons = per_batch * batches.size();
  return result;
}

}  // namespace lampglow::scattering
