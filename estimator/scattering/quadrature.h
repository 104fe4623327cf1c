// Gauss-Legendre nodes and weights on [-1, 1].
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace lampglow::scattering {

template <std::size_t N>
struct GaussLegendre {
  std::array<double, N> node{}, weight{};

  // Newton's method on L_N from the usual first guess (Abramowitz and Stegun 25.4.29).
  GaussLegendre() {
    for (std::size_t i = 0; i < N; ++i) {
      double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (N + 0.5)), slope = 0;
      for (int round = 0; round < 8; ++round) {
        double value = x, before = 1;
        for (std::size_t m = 2; m <= N; ++m) {
          const double order = static_cast<double>(m);
          const double next = ((2 * order - 1) * x * value - (order - 1) * before) / order;
          before = value;
          value = next;
        }
        slope = N * (x * value - before) / (x * x - 1);
        x -= value / slope;
      }
      node[i] = x;
      weight[i] = 2 / ((1 - x * x) * slope * slope);
    }
  }

  static const GaussLegendre& get() {
    static const GaussLegendre rule;
    return rule;
  }
};

}  // namespace lampglow::scattering
