#include "estimator/scattering/random.h"

#include <cmath>
#include <numbers>

namespace lampglow::scattering {

namespace {

std::uint64_t split_mix(std::uint64_t& state) {
  std::uint64_t z = (state += 0x9e3779b97f4a7c15u);
  z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
  z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
  return z ^ (z >> 31);
}

// Above this mean the rounded normal distribution is within 1 % of Poisson's in every quantile that matters
// here.
constexpr double kPoissonByNormal = 60;

}  // namespace

Random::Random(std::uint64_t seed, std::initializer_list<std::uint64_t> stream_name) {
  std::uint64_t state = seed;
  for (std::uint64_t part : stream_name) state = split_mix(state) ^ (part * 0xd1342543de82ef95u);
  for (std::uint64_t& word : state_) word = split_mix(state);
}

// Box and Muller's pair; the second is kept for the next call.
double Random::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_normal_;
  }
  const double radius = std::sqrt(-2 * std::log(1 - uniform()));
  const double angle = 2 * std::numbers::pi * uniform();
  spare_normal_ = radius * std::sin(angle);
  has_spare_ = true;
  return radius * std::cos(angle);
}

double Random::poisson(double mean) {
  if (mean > kPoissonByNormal) return std::fmax(0, std::round(mean + std::sqrt(mean) * normal()));
  double probability = std::exp(-mean);  // inversion: the first k whose cumulative probability exceeds u
  double cumulative = probability;
  const double u = uniform();
  int k = 0;
  while (u > cumulative && k < 400) {
    ++k;
    probability *= mean / k;
    cumulative += probability;
  }
  return k;
}

}  // namespace lampglow::scattering
