// Uniform cubic B-splines: C2 everywhere, exact derivatives, four coefficients per axis for a value.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace lampglow::scattering {

// One axis: `nodes` evenly spaced values from first on, nodes >= 2; it has nodes + 2 coefficients.
struct SplineAxis {
  double first = 0;
  double step = 1;
  std::size_t nodes = 2;

  std::size_t coefficients() const { return nodes + 2; }
  double last() const { return first + step * static_cast<double>(nodes - 1); }
};

// The first of the four coefficients that count at x, their weights, and the weights of the derivative d/dx.
struct SplineWeights {
  std::size_t index = 0;
  std::array<double, 4> value{}, slope{};
};

inline SplineWeights spline_weights(const SplineAxis& axis, double x) {
  const double position = std::clamp((x - axis.first) / axis.step, 0.0, static_cast<double>(axis.nodes - 1));
  const std::size_t cell = std::min(static_cast<std::size_t>(position), axis.nodes - 2);
  const double t = position - static_cast<double>(cell), s = 1 - t, scale = 1 / axis.step;
  return {cell,
          {s * s * s / 6, (t * t * (3 * t - 6) + 4) / 6, (s * s * (3 * s - 6) + 4) / 6, t * t * t / 6},
          {-s * s / 2 * scale, t * (1.5 * t - 2) * scale, -s * (1.5 * s - 2) * scale, t * t / 2 * scale}};
}

// The matrix [nodes + 2][nodes] that takes values at the nodes to coefficients of the interpolating spline
// whose third derivative is continuous at the second and last but one node ("not a knot"). nodes >= 4.
std::vector<double> spline_interpolation_matrix(std::size_t nodes);

}  // namespace lampglow::scattering
