#include "estimator/scattering/bspline.h"

#include <cmath>
#include <stdexcept>

namespace lampglow::scattering {
namespace {

// Gauss and Jordan with row pivots: [a | b] becomes [1 | a^-1 b].
void eliminate(std::vector<std::vector<double>>& rows) {
  const std::size_t n = rows.size();
  for (std::size_t column = 0; column < n; ++column) {
    std::size_t best = column;
    for (std::size_t row = column; row < n; ++row)
      if (std::abs(rows[row][column]) > std::abs(rows[best][column])) best = row;
    std::swap(rows[best], rows[column]);
    const double pivot = rows[column][column];
    for (double& value : rows[column]) value /= pivot;
    for (std::size_t row = 0; row < n; ++row) {
      const double factor = rows[row][column];
      if (row == column || factor == 0) continue;
      for (std::size_t k = column; k < rows[row].size(); ++k) rows[row][k] -= factor * rows[column][k];
    }
  }
}

}  // namespace

std::vector<double> spline_interpolation_matrix(std::size_t nodes) {
  if (nodes < 4) throw std::invalid_argument("spline: needs at least 4 nodes");
  const std::size_t n = nodes + 2;
  std::vector<std::vector<double>> rows(n, std::vector<double>(n + nodes));
  const std::array<double, 5> jump{1, -4, 6, -4, 1};
  for (std::size_t k = 0; k < jump.size(); ++k) {
    rows[0][k] = jump[k];
    rows[n - 1][n - 1 - k] = jump[k];
  }
  for (std::size_t i = 0; i < nodes; ++i) {
    rows[i + 1][i] = rows[i + 1][i + 2] = 1.0 / 6;
    rows[i + 1][i + 1] = 4.0 / 6;
    rows[i + 1][n + i] = 1;
  }
  eliminate(rows);
  std::vector<double> matrix(n * nodes);
  for (std::size_t k = 0; k < n; ++k)
    for (std::size_t i = 0; i < nodes; ++i) matrix[k * nodes + i] = rows[k][n + i];
  return matrix;
}

}  // namespace lampglow::scattering
