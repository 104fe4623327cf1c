#include "estimator/inference/joint_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

constexpr double kWideGainSigma = 3.0;
constexpr double kSkySigma = 30.0;

// r → sign(r)·√ρ(r²) with Cauchy's ρ = c² ln(1 + r²/c²): the same minimum as a loss function, in one residual
// block.
double soften(double r, double tail, double& slope) {
  const double c2 = tail * tail, s = r * r;
  if (s < 1e-12) {
    slope = 1.0;
    return r;
  }
  const double softened = std::sqrt(c2 * std::log1p(s / c2));
  slope = std::abs(r) / (1.0 + s / c2) / softened;
  return std::copysign(softened, r);
}

class FrameCost {
 public:
  FrameCost(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options)
      : scene_(scene), halo_(halo), data_(data), options_(options), at_(scene.lamps().size()) {
    for (size_t r = 0; r < scene.ring_count(); ++r)
      if (data.used[r]) rings_.push_back(r);
  }

  size_t parameter_count() const { return at_.size(); }
  size_t residual_count() const { return rings_.size() + 6 + 4 * at_.lamps; }

  void evaluate(const double* p, double* residuals, double* jacobian) const {
    const std::span<const double> parameters(p, at_.size());
    scene_.evaluate(halo_, parameters, data_.lit, data_.sky_unit, output_, jacobian != nullptr);
    const size_t columns = at_.size();
    for (size_t i = 0; i < rings_.size(); ++i) {
      const size_t r = rings_[i];
      double slope = 0;
      residuals[i] = soften((output_.model[r] - data_.value[r]) / data_.sigma[r], options_.ring_tail, slope);
      if (!jacobian) continue;
      const double scale = slope / data_.sigma[r];
      const double* from = &output_.jacobian[r * columns];
      double* to = jacobian + i * columns;
      for (size_t c = 0; c < columns; ++c) to[c] = from[c] * scale;
    }
    priors(p, residuals, jacobian);
  }

 private:
  void priors(const double* p, double* residuals, double* jacobian) const {
    const size_t columns = at_.size();
    size_t row = rings_.size();
    if (jacobian) std::fill(jacobian + row * columns, jacobian + residual_count() * columns, 0.0);
    const auto pull = [&](size_t parameter, double mean, double sigma, bool heavy_tail) {
      double slope = 1.0;
      double r = sigma > 0 ? (p[parameter] - mean) / sigma : 0.0;
      if (heavy_tail) r = soften(r, options_.prior_tail, slope);
      residuals[row] = r;
      if (jacobian && sigma > 0) jacobian[row * columns + parameter] = slope / sigma;
      ++row;
    };
    constexpr double kStep = 1e-4;
    const double ln_sigma = p[Layout::ln_sigma], q_mean = prior_q(ln_sigma, options_);
    if (jacobian)
      jacobian[row * columns + Layout::ln_sigma] =
          -(prior_q(ln_sigma + kStep, options_) - prior_q(ln_sigma - kStep, options_)) / (2 * kStep) /
          options_.q_sigma;
    pull(Layout::q, q_mean, options_.q_sigma, false);
    pull(Layout::ln_gain, 0, options_.gain_known ? options_.ln_gain_sigma : kWideGainSigma,
         options_.gain_known);
    const double core = scene_.spread().core_ln_sigma;
    pull(Layout::ln_kappa, 0, options_.kappa_sigma > 0 ? options_.kappa_sigma : core, false);
    pull(Layout::emission, options_.emission_mean, options_.emission_sigma, false);
    pull(Layout::slope_x, 0, options_.slope_sigma, false);
    pull(Layout::slope_y, 0, options_.slope_sigma, false);
    for (size_t j = 0; j < at_.lamps; ++j) {
      const SceneLamp& lamp = scene_.lamps()[j];
      pull(at_.ln_strength(j), data_.ln_dimming.empty() ? 0 : data_.ln_dimming[j], lamp.ln_strength_sigma,
           true);
      pull(at_.ln_halo(j), 0, lamp.ln_halo_sigma, false);
      pull(at_.ln_distance(j), 0, lamp.distance_ln_sigma, false);
      pull(at_.sky(j), 1, kSkySigma, false);
    }
  }

  const Scene& scene_;
  const HaloModel& halo_;
  const RingData& data_;
  const FitOptions& options_;
  Layout at_;
  std::vector<size_t> rings_;
  mutable Scene::Output output_;
};

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

struct Limits {
  double ln_sigma_low, ln_sigma_high;
};

Limits limits_of(const FitOptions& options) {
  return {std::log(kMorTimesExtinction / options.max_mor_m),
          std::log(kMorTimesExtinction / options.min_mor_m)};
}

// Parameters that this scene and frame leave nothing to say about.
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

struct Solved {
  double cost = std::numeric_limits<double>::infinity();
  bool converged = false;
  int iterations = 0;
  std::string message;
  std::vector<double> parameters;
};

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

// The skies that suit the given light best, lamp by lamp: they are linear.
void settle_skies(const Scene& scene, const HaloModel& halo, const RingData& data, std::vector<double>& p) {
  const Layout at(scene.lamps().size());
  for (size_t j = 0; j < at.lamps; ++j) p[at.sky(j)] = 0;
  Scene::Output output;
  scene.evaluate(halo, p, data.lit, data.sky_unit, output, false);
  std::vector<double> sum(at.lamps, 0), weight(at.lamps, 0);
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    const auto lamp = static_cast<size_t>(scene.lamp_of_ring(r));
    const double w = 1.0 / (data.sigma[r] * data.sigma[r]);
    sum[lamp] += w * (data.value[r] - output.model[r]);
    weight[lamp] += w;
  }
  for (size_t j = 0; j < at.lamps; ++j)
    p[at.sky(j)] = weight[j] > 0 ? std::max(0.0, sum[j] / weight[j]) / data.sky_unit : 1.0;
}

struct Start {
  double cost;
  std::vector<double> parameters;
};

// A coarse scan over σ and the gain's two likely states (as usual, dimmed by half); the best three at unlike
// σ.
std::vector<Start> starts(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FrameCost& cost, const FitOptions& options) {
  const Layout at(scene.lamps().size());
  std::vector<Start> all;
  std::vector<double> residuals(cost.residual_count());
  const std::vector<double> gains =
      options.gain_known ? std::vector<double>{0.0, -0.69} : std::vector<double>{0.0, -0.7, 0.7, -1.6, 1.6};
  for (double mor = 35; mor < 60e3; mor *= 1.7)
    for (const double ln_gain : gains) {
      std::vector<double> p(at.size(), 0.0);
      for (size_t j = 0; j < data.ln_dimming.size(); ++j) p[at.ln_strength(j)] = data.ln_dimming[j];
      p[Layout::ln_sigma] = std::log(kMorTimesExtinction / mor);
      p[Layout::q] = std::min(prior_q(p[Layout::ln_sigma], options), halo.max_q());
      p[Layout::ln_gain] = ln_gain;
      p[Layout::emission] = options.emission_mean;
      settle_skies(scene, halo, data, p);
      cost.evaluate(p.data(), residuals.data(), nullptr);
      double sum = 0;
      for (const double r : residuals) sum += r * r / 2;
      all.push_back({sum, std::move(p)});
    }
  std::stable_sort(all.begin(), all.end(), [](const Start& a, const Start& b) { return a.cost < b.cost; });
  std::vector<Start> best;
  for (Start& s : all) {
    const bool near = std::any_of(best.begin(), best.end(), [&](const Start& b) {
      return std::abs(b.parameters[Layout::ln_sigma] - s.parameters[Layout::ln_sigma]) < 0.6;
    });
    if (!near) best.push_back(std::move(s));
    if (best.size() == 4) break;
  }
  return best;
}

void add_covariance(const Scene& scene, const FrameCost& cost, const RingData& data,
                    const FitOptions& options, JointFit& fit) {
  const auto columns = static_cast<Eigen::Index>(cost.parameter_count());
  const auto rows = static_cast<Eigen::Index>(cost.residual_count());
  std::vector<double> residuals(cost.residual_count());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(rows, columns);
  cost.evaluate(fit.parameters.data(), residuals.data(), jacobian.data());
  Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  for (const int held : held_parameters(scene, data, options, false)) {
    information.row(held).setZero();
    information.col(held).setZero();
    information(held, held) = 1e20;
  }
  information.diagonal().array() += 1e-9;
  const Eigen::MatrixXd covariance = information.ldlt().solve(Eigen::MatrixXd::Identity(columns, columns));
  fit.sigma.resize(cost.parameter_count());
  for (Eigen::Index c = 0; c < columns; ++c)
    fit.sigma[static_cast<size_t>(c)] = covariance(c, c) > 0 ? std::sqrt(covariance(c, c)) : 0;
}

// Walks from the best fit to one side, σ held at each step, until the probability has fallen far enough.
void walk(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
          double step, double max_q, JointFit& fit) {
  constexpr double kFarEnough = 4.5;  // −Δ ln p; 95 % bounds need 1.92
  constexpr int kMaxSteps = 12;
  const Limits limits = limits_of(options);
  std::vector<double> p = fit.parameters;
  double x = fit.ln_sigma(), previous = fit.cost;
  for (int i = 0; i < kMaxSteps; ++i) {
    x += step;
    if (x <= limits.ln_sigma_low || x >= limits.ln_sigma_high) return;
    p[Layout::ln_sigma] = x;
    const Solved solved = solve(scene, cost, data, options, p, true, 6, max_q);
    p = solved.parameters;
    fit.posterior.push_back({x, solved.cost, p[Layout::q], 0});
    if (solved.cost < fit.cost - 0.1) fit.deeper = p;
    if (solved.cost - fit.cost > kFarEnough) return;
    if (solved.cost - previous < 0.3) step *= 1.6;
    previous = solved.cost;
  }
}

void add_posterior(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
                   double max_q, JointFit& fit) {
  fit.posterior.push_back({fit.ln_sigma(), fit.cost, fit.parameters[Layout::q], fit.sigma[Layout::q]});
  const double step = std::clamp(fit.sigma[Layout::ln_sigma], 0.01, 0.7);
  walk(scene, cost, data, options, step, max_q, fit);
  walk(scene, cost, data, options, -step, max_q, fit);
  std::sort(fit.posterior.begin(), fit.posterior.end(),
            [](const PosteriorPoint& a, const PosteriorPoint& b) { return a.ln_sigma < b.ln_sigma; });
}

JointFit finish(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
                const FrameCost& cost, double max_q, Solved best) {
  JointFit fit;
  fit.converged = best.converged;
  fit.message = best.message;
  fit.cost = best.cost;
  fit.parameters = std::move(best.parameters);
  add_covariance(scene, cost, data, options, fit);
  Scene::Output output;
  scene.evaluate(halo, fit.parameters, data.lit, data.sky_unit, output, false);
  fit.model = output.model;
  int count = 0;
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    const double z = (fit.model[r] - data.value[r]) / data.sigma[r];
    fit.chi2_per_ring += std::min(z * z, 100.0);
    ++count;
  }
  if (count > 0) fit.chi2_per_ring /= count;
  if (options.posterior) add_posterior(scene, cost, data, options, max_q, fit);
  return fit;
}

}  // namespace

// Droplets grow as the air thickens: q's classes (physics.md) run from air to fog with falling visibility.
double prior_q(double ln_sigma, const FitOptions& options) {
  const double ln_mor = std::log(kMorTimesExtinction) - ln_sigma;
  const double x = (ln_mor - std::log(300.0)) / (std::log(30e3) - std::log(300.0));
  const double smooth = 1.0 / (1.0 + std::exp(-6.0 * (x - 0.5)));
  return options.q_mean_fog + (options.q_mean_clear - options.q_mean_fog) * smooth;
}

Residuals residuals_at(const Scene& scene, const HaloModel& halo, const RingData& data,
                       const FitOptions& options, std::span<const double> parameters) {
  const FrameCost cost(scene, halo, data, options);
  Residuals out;
  out.value.resize(cost.residual_count());
  out.jacobian.resize(cost.residual_count() * cost.parameter_count());
  cost.evaluate(parameters.data(), out.value.data(), out.jacobian.data());
  return out;
}

JointFit fit_jointly(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options) {
  const FrameCost cost(scene, halo, data, options);
  const double max_q = halo.max_q();
  Solved best;
  int iterations = 0;
  for (const Start& start : starts(scene, halo, data, cost, options)) {
    Solved solved = solve(scene, cost, data, options, start.parameters, false, options.max_iterations, max_q);
    iterations += solved.iterations;
    if (solved.cost < best.cost) best = std::move(solved);
  }
  JointFit fit = finish(scene, halo, data, options, cost, max_q, std::move(best));
  // The walk along ln σ may come upon a deeper minimum: then the fit starts anew from there, once.
  if (!fit.deeper.empty()) {
    Solved again = solve(scene, cost, data, options, fit.deeper, false, options.max_iterations, max_q);
    iterations += again.iterations;
    if (again.cost < fit.cost) fit = finish(scene, halo, data, options, cost, max_q, std::move(again));
  }
  fit.iterations = iterations;
  return fit;
}

}  // namespace lampglow::inference
