// A small, fast, portable source of random bits: xoshiro256++ (Blackman and Vigna 2021, ACM TOMS 47, 36)
// seeded by splitmix64. The same numbers on every machine, which std::uniform_real_distribution does not
// promise.
#pragma once

#include <array>
#include <cstdint>

namespace lampglow::scattering {

class Random {
 public:
  // Streams of one seed are independent of each other: one for each block of photons.
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0) {
    std::uint64_t state = seed ^ (stream * 0xd1342543de82ef95u + 0x632be59bd9b4e019u);
    for (std::uint64_t& word : state_) word = split_mix(state);
  }

  std::uint64_t bits() {
    const std::uint64_t result = rotate(state_[0] + state_[3], 23) + state_[0];
    const std::uint64_t shifted = state_[1] << 17;
    state_[2] ^= state_[0];
    state_[3] ^= state_[1];
    state_[1] ^= state_[2];
    state_[0] ^= state_[3];
    state_[2] ^= shifted;
    state_[3] = rotate(state_[3], 45);
    return result;
  }

  // In (0, 1), 53 bits.
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }

  // Two numbers in (0, 1) of 23 bits each from one draw.
  std::array<float, 2> two_uniforms() {
    const std::uint64_t word = bits();
    return {(static_cast<float>(word >> 41) + 0.5f) * 0x1p-23f,
            (static_cast<float>((word >> 9) & 0x7fffff) + 0.5f) * 0x1p-23f};
  }

 private:
  static std::uint64_t rotate(std::uint64_t x, int k) { return (x << k) | (x >> (64 - k)); }
  static std::uint64_t split_mix(std::uint64_t& state) {
    std::uint64_t z = (state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
  }

  std::array<std::uint64_t, 4> state_{};
};

}  // namespace lampglow::scattering
