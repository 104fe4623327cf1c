// Random numbers that are the same on every machine and for any number of threads: each use has a stream of
// its own, made from the seed and the numbers that name the use.
#pragma once

#include <array>
#include <cstdint>
#include <initializer_list>

namespace lampglow::simulation {

// xoshiro256** (Blackman, Vigna 2018), seeded through SplitMix64.
class Random {
 public:
  // Streams with different names are independent.
  Random(std::uint64_t seed, std::initializer_list<std::uint64_t> stream_name);

  std::uint64_t bits();
  double uniform();                         // [0, 1)
  double uniform(double low, double high);  // [low, high)
  double normal();                          // mean 0, standard deviation 1
  double poisson(double mean);              // a whole number; mean >= 0
  int below(int count);                     // 0..count-1, count >= 1
  bool chance(double probability) { return uniform() < probability; }

 private:
  std::array<std::uint64_t, 4> state_;
  double spare_normal_ = 0;
  bool has_spare_ = false;
};

}  // namespace lampglow::simulation
