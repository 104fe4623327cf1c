#include "estimator/inference/least_squares.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimator/inference/solver_stop.h"
#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

// Ceres sees the normal equations alone: with L Lᵀ = Jᵀ J and z = L⁻¹ Jᵀ r, the residuals z and what is left
// of r² have the same cost and the same normal equations as all rings, but are as few as the parameters.
class CeresCost final : public ceres::CostFunction {
 public:
  CeresCost(const FrameCost& cost, std::span<const int> active, std::span<const double> all)
      : cost_(cost), active_(active.begin(), active.end()), all_(all.begin(), all.end()) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(active.size()));
    set_num_residuals(static_cast<int>(active.size()) + 1);
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const std::vector<double> p = expanded(parameters[0]);
    const size_t n = active_.size();
    std::fill(residuals, residuals + n, 0.0);
    if (!jacobians) {
      residuals[n] = std::sqrt(2 * cost_.cost(p.data()));
      return true;
    }
    const NormalEquations normal = cost_.normal_equations(p.data(), active_);
    const auto size = static_cast<Eigen::Index>(n);
    Eigen::MatrixXd information = Eigen::Map<const Eigen::MatrixXd>(normal.information.data(), size, size);
    information.diagonal() *= 1 + 1e-12;  // what nothing tells of must not stop it
    information.diagonal().array() += 1e-9;
    const Eigen::LLT<Eigen::MatrixXd> root(information);
    if (root.info() != Eigen::Success) return false;
    Eigen::Map<Eigen::VectorXd> z(residuals, size);
    z = root.matrixL().solve(Eigen::Map<const Eigen::VectorXd>(normal.gradient.data(), size));
    residuals[n] = std::sqrt(std::max(0.0, 2 * normal.cost - z.squaredNorm()));
    Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>> jacobian(
        jacobians[0], size + 1, size);
    jacobian.setZero();
    jacobian.topRows(size) = root.matrixU();
    return true;
  }

  // All parameters, the held ones as they were given.
  std::vector<double> expanded(const double* active) const {
    std::vector<double> p = all_;
    for (size_t i = 0; i < active_.size(); ++i) p[static_cast<size_t>(active_[i])] = active[i];
    return p;
  }

 private:
  const FrameCost& cost_;
  std::vector<int> active_;
  std::vector<double> all_;
};

}  // namespace

void stop_if_given_up(const std::function<bool()>& given_up) {
  if (given_up && given_up()) throw FitStopped();
}

void stop_if_given_up(const FitOptions& options) {
  stop_if_given_up(options.given_up);
}

Limits limits_of(const FitOptions& options) {
  return {std::log(kMorTimesExtinction / options.max_mor_m),
          std::log(kMorTimesExtinction / options.min_mor_m)};
}

std::vector<int> held_parameters(const Scene& scene, const RingData& data, const FitOptions& options,
                                 bool hold_sigma) {
  const Layout at(scene.lamps().size());
  std::vector<int> held;
  if (hold_sigma) held.push_back(static_cast<int>(Layout::ln_sigma));
  if (options.kappa_sigma <= 0 && scene.spread().core_ln_sigma <= 0) held.push_back(Layout::ln_kappa);
  for (size_t j = 0; j < at.lamps; ++j) {
    const SceneLamp& lamp = scene.lamps()[j];
    if (!data.lit[j] || lamp.ln_strength_sigma <= 0) held.push_back(static_cast<int>(at.ln_strength(j)));
    if (!data.lit[j] || lamp.ln_halo_sigma <= 0) held.push_back(static_cast<int>(at.ln_halo(j)));
    if (!data.lit[j] || lamp.distance_ln_sigma <= 0) held.push_back(static_cast<int>(at.ln_distance(j)));
  }
  std::sort(held.begin(), held.end());
  return held;
}

std::vector<int> free_parameters(const Scene& scene, const RingData& data, const FitOptions& options,
                                 bool hold_sigma) {
  const std::vector<int> held = held_parameters(scene, data, options, hold_sigma);
  std::vector<int> free;
  for (int i = 0; i < static_cast<int>(Layout(scene.lamps().size()).size()); ++i)
    if (!std::binary_search(held.begin(), held.end(), i)) free.push_back(i);
  return free;
}

Solved solve(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
             std::vector<double> start, bool hold_sigma, int max_iterations, double max_q) {
  const std::vector<int> active = free_parameters(scene, data, options, hold_sigma);
  std::vector<double> x;
  x.reserve(active.size());
  for (const int i : active) x.push_back(start[static_cast<size_t>(i)]);
  CeresCost ceres_cost(cost, active, start);
  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  problem.AddResidualBlock(&ceres_cost, nullptr, x.data());
  const Limits limits = limits_of(options);
  for (size_t i = 0; i < active.size(); ++i) {
    const auto bound = [&](double low, double high) {
      problem.SetParameterLowerBound(x.data(), static_cast<int>(i), low);
      problem.SetParameterUpperBound(x.data(), static_cast<int>(i), high);
    };
    if (active[i] == Layout::ln_sigma) bound(limits.ln_sigma_low, limits.ln_sigma_high);
    if (active[i] == Layout::q) bound(0.0, max_q);
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = max_iterations;
  // A step that gains less than 0.01 of −ln p is the last; a ring costs about a quarter.
  solver.function_tolerance = 0.04 / static_cast<double>(std::max<size_t>(scene.ring_count(), 1));
  solver.parameter_tolerance = 1e-7;
  solver.max_num_line_search_step_size_iterations = 0;  // the bounds' line search doubles the evaluations
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  SolverStop given_up(options.given_up);
  solver.callbacks.push_back(&given_up);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  stop_if_given_up(options);
  return {summary.final_cost, summary.termination_type == ceres::CONVERGENCE,
          static_cast<int>(summary.iterations.size()), summary.message, ceres_cost.expanded(x.data())};
}

}  // namespace lampglow::inference
