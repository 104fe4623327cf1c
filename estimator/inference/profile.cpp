#include "estimator/inference/profile.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimator/inference/least_squares.h"

namespace lampglow::inference {
namespace {

// Where the walk comes to if it goes on by dx, with these slopes d p / d ln σ.
std::vector<double> ahead(const std::vector<double>& now, std::span<const double> slope, double dx,
                          double max_q) {
  std::vector<double> p = now;
  for (size_t i = 0; i < p.size(); ++i) p[i] += slope[i] * dx;
  p.at(Layout::ln_sigma) = now.at(Layout::ln_sigma) + dx;
  p.at(Layout::q) = std::clamp(p.at(Layout::q), 0.0, max_q);
  return p;
}

// Walks from the best fit to one side, σ held at each step, until the probability has fallen far enough.
void walk(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
          double step, std::span<const double> along_ln_sigma, double max_q, JointFit& fit) {
  constexpr double kFarEnough = 4.5;  // −Δ ln p; 95 % bounds need 1.92
  constexpr int kMaxSteps = 12;
  const Limits limits = limits_of(options);
  std::vector<double> p = fit.parameters, slope(along_ln_sigma.begin(), along_ln_sigma.end());
  double previous = fit.cost;
  for (int i = 0; i < kMaxSteps; ++i) {
    const double x = p.at(Layout::ln_sigma) + step;
    if (x <= limits.ln_sigma_low || x >= limits.ln_sigma_high) return;
    const Solved solved = solve(scene, cost, data, options, ahead(p, slope, step, max_q), true, 6, max_q);
    for (size_t k = 0; k < p.size(); ++k) slope[k] = (solved.parameters[k] - p[k]) / step;
    p = solved.parameters;
    fit.posterior.push_back({x, solved.cost, p.at(Layout::q), 0});
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

Covariance covariance_at(const Scene& scene, const FrameCost& cost, const RingData& data,
                         const FitOptions& options, std::span<const double> parameters) {
  const std::vector<int> active = free_parameters(scene, data, options, false);
  const NormalEquations normal = cost.normal_equations(parameters.data(), active);
  const auto size = static_cast<Eigen::Index>(active.size());
  Eigen::MatrixXd information = Eigen::Map<const Eigen::MatrixXd>(normal.information.data(), size, size);
  information.diagonal().array() += 1e-9;
  const Eigen::MatrixXd covariance = information.ldlt().solve(Eigen::MatrixXd::Identity(size, size));
  Covariance out{std::vector<double>(cost.parameter_count(), 0.0),
                 std::vector<double>(cost.parameter_count(), 0.0)};
  for (Eigen::Index c = 0; c < size; ++c) {
    const auto parameter = static_cast<size_t>(active[static_cast<size_t>(c)]);
    if (covariance(c, c) > 0) out.deviations[parameter] = std::sqrt(covariance(c, c));
    // ln σ is the first of the free parameters.
    if (covariance(0, 0) > 0) out.along_ln_sigma[parameter] = covariance(c, 0) / covariance(0, 0);
  }
  return out;
}

void add_posterior(const Scene& scene, const FrameCost& cost, const RingData& data, const FitOptions& options,
                   std::span<const double> along_ln_sigma, double max_q, JointFit& fit) {
  fit.posterior.push_back({fit.ln_sigma(), fit.cost, fit.parameters[Layout::q], fit.sigma[Layout::q]});
  const double step = std::clamp(fit.sigma[Layout::ln_sigma], 0.01, 0.7);
  walk(scene, cost, data, options, step, along_ln_sigma, max_q, fit);
  walk(scene, cost, data, options, -step, along_ln_sigma, max_q, fit);
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
