// Random numbers that are the same on every machine and for any number of threads, which the standard
// library's distributions do not promise: xoshiro256** (Blackman and Vigna 2021, ACM TOMS 47, 36) seeded
// through splitmix64. Each use has a stream of its own, made from the seed and the numbers that name the use.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <initializer_list>

namespace lampglow::scattering {

class Random {
 public:
  // Streams with different names are independent.
  Random(std::uint64_t seed, std::initializer_list<std::uint64_t> stream_name);
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0) : Random(seed, {stream}) {}

  std::uint64_t bits() {
    const std::uint64_t result = std::rotl(state_[1] * 5, 7) * 9;
    const std::uint64_t shifted = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= shifted;
    state_[3] = std::rotl(state_[3], 45);
    return result;
  }

  double uniform() { return static_cast<double>(bits() >> 11) * 0x1p-53; }  // [0, 1)
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  // (0, 1): for logarithms.
  double open_uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }

  // Two numbers in (0, 1) of 23 bits each from one draw.
  std::array<float, 2> two_uniforms() {
    const std::uint64_t word = bits();
    return {(static_cast<float>(word >> 41) + 0.5f) * 0x1p-23f,
            (static_cast<float>((word >> 9) & 0x7fffff) + 0.5f) * 0x1p-23f};
  }

  double normal();                                                      // mean 0, standard deviation 1
  double poisson(double mean);                                          // a whole number; mean >= 0
  int below(int count) { return static_cast<int>(uniform() * count); }  // 0..count-1, count >= 1
  bool chance(double probability) { return uniform() < probability; }

 private:
  std::array<std::uint64_t, 4> state_;
  double spare_normal_ = 0;
  bool has_spare_ = false;
};

}  // namespace lampglow::scattering
