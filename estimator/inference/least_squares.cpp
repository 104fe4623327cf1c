#include "estimator/inference/least_squares.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>

#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

class CeresCost final : public ceres::CostFunction {
 public:
  explicit CeresCost(const FrameCost& cost) : cost_(cost) {
    mutable_parameter_block_sizes()->push_back(static_cast<int>(cost.parameter_count()));
    set_num_residuals(static_cast<int>(cost.residual_count()));
  }
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    cost_.evaluate(parameters[0], residuals, jacobians ? jacobians[0] : nullptr);
    return true;
  }

 private:
  const FrameCost& cost_;
};

}  // namespace

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

Solved solve(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
             std::vector<double> start, bool hold_sigma, int max_iterations, double max_q) {
  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  CeresCost ceres_cost(cost);
  problem.AddParameterBlock(start.data(), static_cast<int>(start.size()));
  problem.AddResidualBlock(&ceres_cost, nullptr, start.data());
  const std::vector<int> held = held_parameters(scene, data, options, hold_sigma);
  if (!held.empty())
    problem.SetManifold(start.data(), new ceres::SubsetManifold(static_cast<int>(start.size()), held));
  const Limits limits = limits_of(options);
  problem.SetParameterLowerBound(start.data(), Layout::ln_sigma, limits.ln_sigma_low);
  problem.SetParameterUpperBound(start.data(), Layout::ln_sigma, limits.ln_sigma_high);
  problem.SetParameterLowerBound(start.data(), Layout::q, 0.0);
  problem.SetParameterUpperBound(start.data(), Layout::q, max_q);
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = max_iterations;
  solver.function_tolerance = 1e-6;
  solver.parameter_tolerance = 1e-7;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  return {summary.final_cost, summary.termination_type == ceres::CONVERGENCE,
          static_cast<int>(summary.iterations.size()), summary.message, std::move(start)};
}

}  // namespace lampglow::inference
