#include "estimator/inference/profile.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimator/inference/least_squares.h"

namespace lampglow::inference {
namespace {

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

}  // namespace

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

void add_posterior(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
                   double max_q, JointFit& fit) {
  fit.posterior.push_back({fit.ln_sigma(), fit.cost, fit.parameters[Layout::q], fit.sigma[Layout::q]});
  const double step = std::clamp(fit.sigma[Layout::ln_sigma], 0.01, 0.7);
  walk(scene, cost, data, options, step, max_q, fit);
  walk(scene, cost, data, options, -step, max_q, fit);
  std::sort(fit.posterior.begin(), fit.posterior.end(),
            [](const PosteriorPoint& a, const PosteriorPoint& b) { return a.ln_sigma < b.ln_sigma; });
}

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

}  // namespace lampglow::inference
