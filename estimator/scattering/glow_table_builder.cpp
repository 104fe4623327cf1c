#include "estimator/scattering/glow_table_builder.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/single_scattering.h"
#include "estimator/scattering/transfer_solution.h"

namespace lampglow::scattering {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Nodes beyond the domain's ends keep the spline's end conditions out of it.
struct PaddedAxis {
  SplineAxis domain;
  std::size_t before = 2, after = 2;

  std::size_t nodes() const { return before + domain.nodes + after; }
  double at(std::size_t node) const {
    return domain.first + domain.step * (static_cast<double>(node) - static_cast<double>(before));
  }
};

PaddedAxis make_axis(double first, double last, std::size_t nodes, std::size_t before = 2) {
  if (nodes < 4) throw std::invalid_argument("glow table: an axis needs at least 4 nodes");
  return {{first, (last - first) / static_cast<double>(nodes - 1), nodes}, before, 2};
}

// Values at nodes -> coefficients, along the axis in the middle of [outer][nodes][inner]; those that only
// matter outside the domain are dropped.
std::vector<double> fit_axis(const std::vector<double>& values, const PaddedAxis& axis, std::size_t inner) {
  const std::size_t nodes = axis.nodes(), kept = axis.domain.coefficients(), slice = nodes * inner;
  if (slice == 0) throw std::invalid_argument("glow table: no values to fit");
  const std::size_t outer = values.size() / slice;
  const std::vector<double> matrix = spline_interpolation_matrix(nodes);
  std::vector<double> result(outer * kept * inner);
  for (std::size_t o = 0; o < outer; ++o)
    for (std::size_t k = 0; k < kept; ++k)
      for (std::size_t n = 0; n < nodes; ++n) {
        const double weight = matrix[(k + axis.before) * nodes + n];
        for (std::size_t i = 0; i < inner; ++i)
          result[(o * kept + k) * inner + i] += weight * values[(o * nodes + n) * inner + i];
      }
  return result;
}

std::vector<float> to_float(const std::vector<double>& values) {
  return {values.begin(), values.end()};
}

struct Grid {
  PaddedAxis albedo, q, thickness, theta;
};

Grid make_grid(const GlowTableOptions& options) {
  return {make_axis(0, std::sqrt(0.2), options.albedo_nodes, 0),
          make_axis(0, -std::log(0.03), options.q_nodes),
          make_axis(std::log(0.01), std::log(15.0), options.thickness_nodes),
          make_axis(std::log(0.01 * kDegree), std::log(90 * kDegree), options.theta_nodes)};
}

// All values of one q: ln(L1/ω0) [T][θ] and ln(L2+/ω0²) [ω0][T][θ].
struct Slab {
  std::vector<double> single, multiple;
};

Slab solve(const Grid& grid, double q) {
  Slab slab;
  const TransferKernel kernel(q);
  for (std::size_t a = 0; a < grid.albedo.nodes(); ++a) {
    const double root = grid.albedo.at(a), albedo = 1 - root * root;
    const TransferSolution solution(kernel, albedo);
    for (std::size_t t = 0; t < grid.thickness.nodes(); ++t)
      for (std::size_t i = 0; i < grid.theta.nodes(); ++i) {
        const double thickness = std::exp(grid.thickness.at(t)), theta = std::exp(grid.theta.at(i));
        slab.multiple.push_back(std::log(solution.multiple(thickness, theta) / (albedo * albedo)));
        if (a == 0) slab.single.push_back(std::log(single_scattering(thickness, q, 1, theta).value));
      }
  }
  return slab;
}

}  // namespace

std::vector<std::byte> build_glow_table(const GlowTableOptions& options, const Executor& executor,
                                        const std::function<void(std::size_t)>& progress) {
  const Grid grid = make_grid(options);
  const std::size_t q_nodes = grid.q.nodes(), plane = grid.thickness.nodes() * grid.theta.nodes();
  std::vector<Slab> slabs(q_nodes);
  executor(q_nodes, [&](std::size_t i) {
    // The dearest (largest q) first, so that no thread waits long for the last.
    const std::size_t node = q_nodes - 1 - i;
    slabs[node] = solve(grid, -std::expm1(-grid.q.at(node)));
    if (progress) progress(q_nodes);
  });

  std::vector<double> single, multiple;
  for (const Slab& slab : slabs) single.insert(single.end(), slab.single.begin(), slab.single.end());
  for (std::size_t a = 0; a < grid.albedo.nodes(); ++a)
    for (const Slab& slab : slabs)
      multiple.insert(multiple.end(), slab.multiple.begin() + static_cast<std::ptrdiff_t>(a * plane),
                      slab.multiple.begin() + static_cast<std::ptrdiff_t>((a + 1) * plane));
  for (const double value : multiple)
    if (!std::isfinite(value))
      throw std::runtime_error("glow table: the solution is not positive everywhere");

  const std::size_t angles = grid.theta.domain.coefficients(), lengths = grid.thickness.domain.coefficients();
  const auto fit = [&](std::vector<double> values, bool with_albedo) {
    values = fit_axis(values, grid.theta, 1);
    values = fit_axis(values, grid.thickness, angles);
    values = fit_axis(values, grid.q, angles * lengths);
    if (with_albedo) values = fit_axis(values, grid.albedo, angles * lengths * grid.q.domain.coefficients());
    return to_float(values);
  };
  GlowTableContents contents;
  contents.axes = {grid.albedo.domain, grid.q.domain, grid.thickness.domain, grid.theta.domain};
  contents.single = fit(single, false);
  contents.multiple = fit(multiple, true);
  return write_glow_table(contents);
}

}  // namespace lampglow::scattering
