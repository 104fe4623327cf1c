#include "estimator/inference/joint_fit.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

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
    const double ln_sigma = p[Layout::ln_sigma];
    const auto q_off = [&](double at) {
      return (p[Layout::q] - prior_q(at, options_)) / prior_q_sigma(at, options_);
    };
    if (jacobian)
      jacobian[row * columns + Layout::ln_sigma] =
          (q_off(ln_sigma + kStep) - q_off(ln_sigma - kStep)) / (2 * kStep);
    pull(Layout::q, prior_q(ln_sigma, options_), prior_q_sigma(ln_sigma, options_), false);
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

// −ln of the probability that just these k of n lamps are dimmed, with nothing known of how many usually are
// (beta-binomial of ½, ½): all or none are likelier than any one mixture.
double mixture_penalty(int n, int k) {
  const double ln_beta = std::lgamma(k + 0.5) + std::lgamma(n - k + 0.5) - std::lgamma(n + 1.0);
  return std::log(std::numbers::pi) - ln_beta;
}

struct Powers {
  double ln_gain = 0, cost = std::numeric_limits<double>::infinity();
  std::vector<double> ln_dimming;
};

double mixture_penalty(const std::vector<double>& ln_dimming, std::span<const char> lit) {
  const auto n = std::count_if(lit.begin(), lit.end(), [](char l) { return l != 0; });
  const auto k = std::count_if(ln_dimming.begin(), ln_dimming.end(), [](double d) { return d != 0; });
  return mixture_penalty(static_cast<int>(n), static_cast<int>(k));
}

// The likeliest gain and power of each lamp, given by how much each is brighter than usual (ln; empty: not
// known).
Powers likeliest_powers(const Scene& scene, const std::vector<std::optional<double>>& ln_ratio,
                        const RingData& data, const FitOptions& options) {
  constexpr double kRatioSigma = 0.04;
  const double gain_sigma = options.gain_known ? options.ln_gain_sigma : kWideGainSigma;
  const double reach = options.gain_known ? 0.6 : 3.0;
  Powers best;
  for (double gain = -reach; gain <= reach + 1e-9; gain += 0.03) {
    double slope = 1.0;
    const double pulled = soften(gain / gain_sigma, options.prior_tail, slope);
    Powers powers{gain, pulled * pulled / 2, std::vector<double>(ln_ratio.size(), 0.0)};
    for (size_t j = 0; j < ln_ratio.size(); ++j) {
      if (!ln_ratio[j] || !data.lit[j]) continue;
      const double rest = *ln_ratio[j] - gain;
      if (std::abs(rest - options.ln_half) < std::abs(rest)) powers.ln_dimming[j] = options.ln_half;
      const double sigma = std::hypot(scene.lamps()[j].ln_strength_sigma, kRatioSigma);
      const double off = soften((rest - powers.ln_dimming[j]) / sigma, options.prior_tail, slope);
      powers.cost += off * off / 2;
    }
    powers.cost += mixture_penalty(powers.ln_dimming, data.lit);
    if (powers.cost < best.cost) best = std::move(powers);
  }
  return best;
}

// By how much each lamp's own rings are brighter than the model has them, its sky being free.
std::vector<std::optional<double>> ring_ratios(const Scene& scene, const HaloModel& halo,
                                               const RingData& data, std::vector<double> p) {
  const Layout at(scene.lamps().size());
  for (size_t j = 0; j < at.lamps; ++j) p[at.sky(j)] = 0;
  Scene::Output output;
  scene.evaluate(halo, p, data.lit, data.sky_unit, output, false);
  struct Sums {
    double w = 0, x = 0, y = 0, xx = 0, xy = 0;
  };
  std::vector<Sums> sums(at.lamps);
  for (size_t r = 0; r < scene.ring_count(); ++r) {
    if (!data.used[r]) continue;
    Sums& s = sums[static_cast<size_t>(scene.lamp_of_ring(r))];
    const double w = 1.0 / (data.sigma[r] * data.sigma[r]), x = output.model[r], y = data.value[r];
    s.w += w, s.x += w * x, s.y += w * y, s.xx += w * x * x, s.xy += w * x * y;
  }
  std::vector<std::optional<double>> ratios(at.lamps);
  for (size_t j = 0; j < at.lamps; ++j) {
    const Sums& s = sums[j];
    const double spread = s.w * s.xx - s.x * s.x, slope = s.w * s.xy - s.x * s.y;
    if (spread > 0 && slope > 0) ratios[j] = std::log(slope / spread);
  }
  return ratios;
}

struct Start {
  double cost;
  std::vector<double> parameters, ln_dimming;
};

double cost_at(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
               const std::vector<double>& p) {
  const FrameCost cost(scene, halo, data, options);
  std::vector<double> residuals(cost.residual_count());
  cost.evaluate(p.data(), residuals.data(), nullptr);
  double sum = 0;
  for (const double r : residuals) sum += r * r / 2;
  return sum;
}

Start start_at(const Scene& scene, const HaloModel& halo, RingData data, const FitOptions& options,
               double mor, std::optional<double> ln_gain) {
  const Layout at(scene.lamps().size());
  std::vector<double> p(at.size(), 0.0);
  p[Layout::ln_sigma] = std::log(kMorTimesExtinction / mor);
  p[Layout::q] = std::min(prior_q(p[Layout::ln_sigma], options), halo.max_q());
  p[Layout::emission] = options.emission_mean;
  data.ln_dimming.assign(at.lamps, 0.0);
  if (!ln_gain) {
    const Powers powers = likeliest_powers(scene, ring_ratios(scene, halo, data, p), data, options);
    data.ln_dimming = powers.ln_dimming;
    ln_gain = powers.ln_gain;
  }
  p[Layout::ln_gain] = *ln_gain;
  for (size_t j = 0; j < at.lamps; ++j) p[at.ln_strength(j)] = data.ln_dimming[j];
  settle_skies(scene, halo, data, p);
  const double cost = cost_at(scene, halo, data, options, p) + mixture_penalty(data.ln_dimming, data.lit);
  return {cost, std::move(p), std::move(data.ln_dimming)};
}

// A coarse scan over σ, with the gain as usual, dimmed by half, or with each lamp at its likeliest power; the
// best few that differ in σ or in powers.
std::vector<Start> starts(const Scene& scene, const HaloModel& halo, const RingData& data,
                          const FitOptions& options) {
  std::vector<std::optional<double>> gains;
  if (options.gain_known)
    gains = {0.0, -0.69};
  else
    gains = {0.0, -0.7, 0.7, -1.6, 1.6};
  if (options.ln_half != 0) gains.emplace_back(std::nullopt);
  std::vector<Start> all;
  for (double mor = 35; mor < 60e3; mor *= 1.5)
    for (const auto& ln_gain : gains) all.push_back(start_at(scene, halo, data, options, mor, ln_gain));
  std::stable_sort(all.begin(), all.end(), [](const Start& a, const Start& b) { return a.cost < b.cost; });
  std::vector<Start> best;
  for (Start& s : all) {
    const bool near = std::any_of(best.begin(), best.end(), [&](const Start& b) {
      return b.ln_dimming == s.ln_dimming &&
             std::abs(b.parameters[Layout::ln_sigma] - s.parameters[Layout::ln_sigma]) < 0.6;
    });
    if (!near) best.push_back(std::move(s));
    if (best.size() == 5) break;
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

namespace {

// 0 in fog, 1 in clear air.
double clearness(double ln_sigma) {
  const double ln_mor = std::log(kMorTimesExtinction) - ln_sigma;
  const double x = (ln_mor - std::log(300.0)) / (std::log(30e3) - std::log(300.0));
  return 1.0 / (1.0 + std::exp(-6.0 * (x - 0.5)));
}

// 0 up to some 5 km, 1 in clear air.
double beyond_haze(double ln_sigma) {
  return std::max(0.0, clearness(ln_sigma) - 0.6) / 0.4;
}

}  // namespace

// Droplets grow as the air thickens: q's classes (physics.md) run from air to fog with falling visibility.
double prior_q(double ln_sigma, const FitOptions& options) {
  return options.q_mean_fog + (options.q_mean_haze - options.q_mean_fog) * clearness(ln_sigma) +
         (options.q_mean_clear - options.q_mean_haze) * beyond_haze(ln_sigma);
}

double prior_q_sigma(double ln_sigma, const FitOptions& options) {
  return options.q_sigma + (options.q_sigma_clear - options.q_sigma) * beyond_haze(ln_sigma);
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

namespace {

// One way to read the frame: which lamps burn at half power, and the best fit to it.
struct Mode {
  RingData data;
  double penalty = 0;
  Solved solved;
  double cost() const { return solved.cost + penalty; }
};

Mode mode_from(const Scene& scene, const HaloModel& halo, const RingData& data, const FitOptions& options,
               std::vector<double> parameters, std::vector<double> ln_dimming) {
  Mode mode;
  mode.data = data;
  mode.data.ln_dimming = std::move(ln_dimming);
  if (options.ln_half != 0) mode.penalty = mixture_penalty(mode.data.ln_dimming, data.lit);
  const FrameCost cost(scene, halo, mode.data, options);
  mode.solved = solve(scene, cost, mode.data, options, std::move(parameters), false, options.max_iterations,
                      halo.max_q());
  return mode;
}

// Chooses the lamps' powers anew by the fit's own strengths, while that makes the fit better.
Mode settled(const Scene& scene, const HaloModel& halo, const FitOptions& options, Mode mode,
             int& iterations) {
  iterations += mode.solved.iterations;
  if (options.ln_half == 0) return mode;
  const Layout at(scene.lamps().size());
  for (int round = 0; round < 3; ++round) {
    std::vector<double> p = mode.solved.parameters;
    std::vector<std::optional<double>> ratios(at.lamps);
    for (size_t j = 0; j < at.lamps; ++j) ratios[j] = p[Layout::ln_gain] + p[at.ln_strength(j)];
    Powers powers = likeliest_powers(scene, ratios, mode.data, options);
    if (powers.ln_dimming == mode.data.ln_dimming) break;
    for (size_t j = 0; j < at.lamps; ++j) p[at.ln_strength(j)] = *ratios[j] - powers.ln_gain;
    p[Layout::ln_gain] = powers.ln_gain;
    Mode next = mode_from(scene, halo, mode.data, options, std::move(p), std::move(powers.ln_dimming));
    iterations += next.solved.iterations;
    if (next.cost() >= mode.cost()) break;
    mode = std::move(next);
  }
  return mode;
}

// Lamps at half power in a far lamp's case are told from thicker air by the others alone: tries the other
// power of each lamp, one by one, and keeps what fits better. Rivals that come near are handed back too.
std::vector<Mode> with_powers_flipped(const Scene& scene, const HaloModel& halo, const FitOptions& options,
                                      Mode best, int& iterations) {
  constexpr double kNear = 3.0;
  const Layout at(scene.lamps().size());
  std::vector<Mode> rivals;
  for (int round = 0; round < 3; ++round) {
    std::vector<Mode> tried;
    for (size_t j = 0; j < at.lamps; ++j) {
      if (!best.data.lit[j]) continue;
      std::vector<double> dimming = best.data.ln_dimming, p = best.solved.parameters;
      dimming[j] = dimming[j] != 0 ? 0.0 : options.ln_half;
      p[at.ln_strength(j)] += dimming[j] - best.data.ln_dimming[j];
      tried.push_back(mode_from(scene, halo, best.data, options, std::move(p), std::move(dimming)));
      iterations += tried.back().solved.iterations;
    }
    if (tried.empty()) break;
    std::stable_sort(tried.begin(), tried.end(),
                     [](const Mode& a, const Mode& b) { return a.cost() < b.cost(); });
    for (const Mode& mode : tried)
      if (mode.cost() < best.cost() + kNear) rivals.push_back(mode);
    if (tried.front().cost() >= best.cost()) break;
    rivals.push_back(best);
    best = tried.front();
  }
  rivals.push_back(std::move(best));
  return rivals;
}

bool burns_unlike_usual(const Mode& mode) {
  constexpr double kUnusualGain = 0.3;
  return std::abs(mode.solved.parameters[Layout::ln_gain]) > kUnusualGain ||
         std::any_of(mode.data.ln_dimming.begin(), mode.data.ln_dimming.end(),
                     [](double d) { return d != 0; });
}

JointFit finish(const Scene& scene, const HaloModel& halo, const FitOptions& options, const Mode& mode) {
  const FrameCost cost(scene, halo, mode.data, options);
  JointFit fit = finish(scene, halo, mode.data, options, cost, halo.max_q(), mode.solved);
  fit.ln_dimming = mode.data.ln_dimming;
  fit.cost += mode.penalty;
  for (PosteriorPoint& point : fit.posterior) point.minus_ln_probability += mode.penalty;
  return fit;
}

// −ln p of a profile between its points, and beyond them along its last slope (never falling).
double profile_at(const std::vector<PosteriorPoint>& p, double x) {
  const auto n = static_cast<size_t>(
      std::lower_bound(p.begin(), p.end(), x, [](const auto& a, double b) { return a.ln_sigma < b; }) -
      p.begin());
  const size_t b = std::clamp<size_t>(n, 1, p.size() - 1), a = b - 1;
  const double slope =
      (p[b].minus_ln_probability - p[a].minus_ln_probability) / std::max(p[b].ln_sigma - p[a].ln_sigma, 1e-9);
  if (x > p.back().ln_sigma)
    return p.back().minus_ln_probability + std::max(slope, 0.0) * (x - p.back().ln_sigma);
  if (x < p.front().ln_sigma)
    return p.front().minus_ln_probability + std::min(slope, 0.0) * (x - p.front().ln_sigma);
  return p[a].minus_ln_probability + slope * (x - p[a].ln_sigma);
}

// The lesser of two profiles at the points of both.
void merge_profiles(const std::vector<PosteriorPoint>& other, std::vector<PosteriorPoint>& profile) {
  if (other.size() < 2 || profile.size() < 2) return;
  std::vector<PosteriorPoint> merged;
  for (PosteriorPoint point : profile) {
    point.minus_ln_probability = std::min(point.minus_ln_probability, profile_at(other, point.ln_sigma));
    merged.push_back(point);
  }
  for (PosteriorPoint point : other) {
    point.minus_ln_probability = std::min(point.minus_ln_probability, profile_at(profile, point.ln_sigma));
    merged.push_back(point);
  }
  std::sort(merged.begin(), merged.end(),
            [](const auto& a, const auto& b) { return a.ln_sigma < b.ln_sigma; });
  profile = std::move(merged);
}

}  // namespace

JointFit fit_jointly(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options) {
  constexpr double kRival = 3.0;  // −Δ ln p of the modes that the bounds must cover
  int iterations = 0;
  std::vector<Mode> modes;
  for (const Start& start : starts(scene, halo, data, options))
    modes.push_back(settled(scene, halo, options,
                            mode_from(scene, halo, data, options, start.parameters, start.ln_dimming),
                            iterations));
  const auto by_cost = [](const Mode& a, const Mode& b) { return a.cost() < b.cost(); };
  std::stable_sort(modes.begin(), modes.end(), by_cost);
  if (options.ln_half != 0 && options.gain_known && burns_unlike_usual(modes.front())) {
    for (Mode& mode : with_powers_flipped(scene, halo, options, modes.front(), iterations))
      modes.push_back(std::move(mode));
    std::stable_sort(modes.begin(), modes.end(), by_cost);
  }
  JointFit fit = finish(scene, halo, options, modes.front());
  // The walk along ln σ may come upon a deeper minimum: then the fit starts anew from there, once.
  if (!fit.deeper.empty()) {
    Mode again = settled(scene, halo, options,
                         mode_from(scene, halo, data, options, fit.deeper, fit.ln_dimming), iterations);
    if (again.cost() < fit.cost) {
      fit = finish(scene, halo, options, again);
      modes.insert(modes.begin(), std::move(again));
    }
  }
  std::vector<const Mode*> covered{&modes.front()};
  for (const Mode& mode : modes) {
    const bool known = std::any_of(covered.begin(), covered.end(), [&](const Mode* c) {
      return c->data.ln_dimming == mode.data.ln_dimming &&
             std::abs(c->solved.parameters[Layout::ln_sigma] - mode.solved.parameters[Layout::ln_sigma]) <
                 0.05;
    });
    if (known || !options.posterior || mode.cost() > fit.cost + kRival) continue;
    covered.push_back(&mode);
    merge_profiles(finish(scene, halo, options, mode).posterior, fit.posterior);
  }
  fit.iterations = iterations;
  return fit;
}

}  // namespace lampglow::inference
