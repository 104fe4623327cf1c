#include "estimator/inference/spread.h"

#include <ceres/ceres.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "estimator/inference/solver_stop.h"

namespace lampglow::inference {
namespace {

constexpr size_t kSpreadNodes = 30;
constexpr double kLastSpreadRad = 16.0 * std::numbers::pi / 180.0;
constexpr double kTail = 2.5;
constexpr double kCoreTail =
    30;  // a core that is seen is no outlier, however many rings of the background say so
constexpr double kEnoughCores =
    0.6;  // with fewer of the lamps unsaturated, the core's share of the light is a guess
constexpr double kUnknownDistance_m = 400;

// Parameters: ln core fraction, ln density at the nodes, ln strength and sky of every lamp, the sky's
// gradient.
struct SpreadLayout {
  size_t nodes, lamps;
  size_t core() const { return 0; }
  size_t node(size_t n) const { return 1 + n; }
  size_t strength(size_t j) const { return 1 + nodes + j; }
  size_t sky(size_t j) const { return 1 + nodes + lamps + j; }
  size_t slope_x() const { return 1 + nodes + 2 * lamps; }
  size_t slope_y() const { return slope_x() + 1; }
  size_t size() const { return slope_y() + 1; }
};

// Averages of the node functions over each ring, for each lamp's light: sparse rows of (node, weight).
struct NodeShare {
  size_t node;
  double weight;
};

class SpreadCost final : public ceres::CostFunction {
 public:
  SpreadCost(const Camera& camera, const photometry::RingMap& map, std::span<const SceneLamp> lamps,
             const HaloModel& halo, const RingData& data, double extinction_per_m,
             const SpreadOptions& options)
      : map_(map), data_(data), options_(options), at_{kSpreadNodes, lamps.size()} {
    make_nodes(camera);
    make_shares(camera, lamps);
    make_halos(camera, lamps, halo, extinction_per_m);
    for (size_t r = 0; r < map.rings.size(); ++r)
      if (data.used[r]) rings_.push_back(r);
    for (const auto& ring : map.rings) {
      const auto [x, y] = sky_position(ring, camera);
      ring_x_.push_back(x);
      ring_y_.push_back(y);
    }
    mutable_parameter_block_sizes()->push_back(static_cast<int>(at_.size()));
    set_num_residuals(static_cast<int>(rings_.size() + kSpreadNodes + 3 + at_.lamps));
  }

  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override {
    const double* p = parameters[0];
    double* jacobian = jacobians ? jacobians[0] : nullptr;
    const size_t columns = at_.size();
    if (jacobian) std::fill(jacobian, jacobian + static_cast<size_t>(num_residuals()) * columns, 0.0);
    for (size_t i = 0; i < rings_.size(); ++i) {
      const double value = ring_model(p, rings_[i], jacobian ? jacobian + i * columns : nullptr);
      soften_row(value, rings_[i], residuals[i], jacobian ? jacobian + i * columns : nullptr);
    }
    priors(p, residuals, jacobian);
    return true;
  }

  double ring_model(const double* p, size_t ring, double* row) const {
    double light = 0;
    const auto own = static_cast<size_t>(map_.rings[ring].lamp);
    for (size_t j = 0; j < at_.lamps; ++j) {
      const double beam = std::exp(p[at_.strength(j)]) * transmission_[j];
      double density = 0;
      if (j == own && map_.rings[ring].theta_low_rad == 0) {
        density = std::exp(p[at_.core()]) / core_area_px_;
        if (row) row[at_.core()] += beam * density;
      } else {
        for (const NodeShare& share : shares_[ring * at_.lamps + j]) {
          const double part = share.weight * std::exp(p[at_.node(share.node)]);
          density += part;
          if (row) row[at_.node(share.node)] += beam * part;
        }
      }
      const double halo = std::exp(p[at_.strength(j)]) * halos_[ring * at_.lamps + j];
      if (row) row[at_.strength(j)] += beam * density + halo;
      light += beam * density + halo;
    }
    if (row) {
      row[at_.sky(own)] += data_.sky_unit;
      row[at_.slope_x()] += data_.sky_unit * ring_x_[ring];
      row[at_.slope_y()] += data_.sky_unit * ring_y_[ring];
    }
    return light + data_.sky_unit * (p[at_.sky(own)] + p[at_.slope_x()] * ring_x_[ring] +
                                     p[at_.slope_y()] * ring_y_[ring]);
  }

  std::vector<double> start() const;
  const SpreadLayout& layout() const { return at_; }
  const std::vector<double>& nodes() const { return nodes_; }
  double core_area_px() const { return core_area_px_; }
  double pixel_sr() const { return pixel_sr_; }

 private:
  void make_nodes(const Camera& camera) {
    const photometry::AngularScale scale(camera);
    pixel_sr_ = 1.0 / (scale.focal_length_px * scale.focal_length_px);
    const double first = map_.edges_rad[1];
    const double ratio = std::pow(kLastSpreadRad / first, 1.0 / (kSpreadNodes - 1));
    for (size_t n = 0; n < kSpreadNodes; ++n)
      nodes_.push_back(first * std::pow(ratio, static_cast<double>(n)));
    core_area_px_ = std::numbers::pi * first * first / pixel_sr_;
    double low = first;
    for (size_t n = 0; n < kSpreadNodes; ++n) {  // area that each node stands for
      const double high = n + 1 < kSpreadNodes ? std::sqrt(nodes_[n] * nodes_[n + 1]) : nodes_[n];
      area_px_.push_back(std::numbers::pi * (high * high - low * low) / pixel_sr_);
      low = high;
    }
  }

  void make_shares(const Camera& camera, std::span<const SceneLamp> lamps) {
    const photometry::AngularScale scale(camera);
    const double step = std::log(nodes_[1] / nodes_[0]);
    std::vector<double> dense(kSpreadNodes);
    for (const auto& ring : map_.rings)
      for (const SceneLamp& lamp : lamps) {
        std::fill(dense.begin(), dense.end(), 0.0);
        const auto to_lamp = scale.direction(lamp.x_px, lamp.y_px);
        for (const auto& sample : ring.samples) {
          const double theta = std::max(photometry::plane_distance(sample, to_lamp), nodes_[0]);
          const double x = std::log(theta / nodes_[0]) / step;
          const auto n = std::min(static_cast<size_t>(x), kSpreadNodes - 2);
          const double f = x - static_cast<double>(n), w = 1.0 / static_cast<double>(ring.samples.size());
          const auto square = [&](size_t k) { return nodes_[k] * nodes_[k] / (theta * theta); };
          if (f >= 1.0) {
            dense[n + 1] += w * square(n + 1);
            continue;
          }
          dense[n] += w * (1 - f) * square(n);
          dense[n + 1] += w * f * square(n + 1);
        }
        std::vector<NodeShare> shares;
        for (size_t n = 0; n < kSpreadNodes; ++n)
          if (dense[n] > 0) shares.push_back({n, dense[n]});
        shares_.push_back(std::move(shares));
      }
  }

  // The clear night's own faint halo of every lamp at unit strength.
  void make_halos(const Camera& camera, std::span<const SceneLamp> lamps, const HaloModel& halo,
                  double extinction) {
    const size_t rings = map_.rings.size();
    halos_.assign(rings * lamps.size(), 0.0);
    std::vector<SceneLamp> bare(lamps.begin(), lamps.end());
    for (SceneLamp& lamp : bare) {
      lamp.ln_strength = 0;
      lamp.distance_m = lamp.distance_m.value_or(kUnknownDistance_m);
      transmission_.push_back(std::exp(-extinction * *lamp.distance_m));
    }
    PointSpread sharp;
    sharp.theta_rad = {1e-3, 2e-3};
    sharp.ln_density = {-60, -60};
    sharp.core_theta_rad = 1e-3;
    const Scene scene(camera, bare, sharp, map_);
    const Layout at(lamps.size());
    std::vector<double> p(at.size(), 0.0);
    p[Layout::ln_sigma] = std::log(extinction);
    p[Layout::q] = options_.clear_q;
    std::vector<char> lit(lamps.size(), 1);
    Scene::Output output;
    scene.evaluate(halo, p, lit, 1.0, output, true);
    for (size_t r = 0; r < rings; ++r)
      for (size_t j = 0; j < lamps.size(); ++j)
        halos_[r * lamps.size() + j] = output.jacobian[r * at.size() + at.ln_halo(j)];
  }

  void soften_row(double model, size_t ring, double& residual, double* row) const {
    const double r = (model - data_.value[ring]) / data_.sigma[ring];
    const double tail = map_.rings[ring].theta_low_rad == 0 ? kCoreTail : kTail, c2 = tail * tail;
    residual = std::copysign(std::sqrt(c2 * std::log1p(r * r / c2)), r);
    if (!row) return;
    const double slope =
        (std::abs(r) < 1e-6 ? 1.0 : std::abs(r) / (1 + r * r / c2) / std::abs(residual)) / data_.sigma[ring];
    for (size_t c = 0; c < at_.size(); ++c) row[c] *= slope;
  }

  // Smooth, ends falling as θ^-2.5 or so, sums to 1, the core's share about as usual.
  void priors(const double* p, double* residuals, double* jacobian) const {
    const size_t columns = at_.size();
    size_t i = rings_.size();
    const double step = std::log(nodes_[1] / nodes_[0]);
    const auto put = [&](size_t column, double value) {
      if (jacobian) jacobian[i * columns + column] += value;
    };
    for (size_t n = 0; n + 2 < kSpreadNodes; ++n, ++i) {
      const double s = options_.smoothness * step;
      residuals[i] = (p[at_.node(n)] - 2 * p[at_.node(n + 1)] + p[at_.node(n + 2)]) / s;
      put(at_.node(n), 1 / s);
      put(at_.node(n + 1), -2 / s);
      put(at_.node(n + 2), 1 / s);
    }
    const double end_sigma = 0.7 * step;
    residuals[i] = (p[at_.node(kSpreadNodes - 1)] - p[at_.node(kSpreadNodes - 2)] + 2.7 * step) / end_sigma;
    put(at_.node(kSpreadNodes - 1), 1 / end_sigma);
    put(at_.node(kSpreadNodes - 2), -1 / end_sigma);
    ++i;
    const double core = std::exp(p[at_.core()]);
    double sum = core;
    for (size_t n = 0; n < kSpreadNodes; ++n) sum += area_px_[n] * std::exp(p[at_.node(n)]);
    constexpr double kSumSigma = 1e-3;
    residuals[i] = (sum - 1.0) / kSumSigma;
    put(at_.core(), core / kSumSigma);
    for (size_t n = 0; n < kSpreadNodes; ++n)
      put(at_.node(n), area_px_[n] * std::exp(p[at_.node(n)]) / kSumSigma);
    ++i;
    residuals[i] = (p[at_.core()] - std::log(options_.core_fraction)) / options_.core_fraction_ln_sigma;
    put(at_.core(), 1 / options_.core_fraction_ln_sigma);
    ++i;
    for (size_t j = 0; j < at_.lamps; ++j, ++i) {
      constexpr double kSkySigma = 30;
      residuals[i] = (p[at_.sky(j)] - 1) / kSkySigma;
      put(at_.sky(j), 1 / kSkySigma);
    }
    for (const size_t slope : {at_.slope_x(), at_.slope_y()}) {
      residuals[i] = p[slope] / options_.slope_sigma;
      put(slope, 1 / options_.slope_sigma);
      ++i;
    }
  }

  const photometry::RingMap& map_;
  const RingData& data_;
  const SpreadOptions& options_;
  SpreadLayout at_;
  std::vector<double> nodes_, area_px_, halos_, transmission_;
  std::vector<std::vector<NodeShare>> shares_;
  std::vector<size_t> rings_;
  std::vector<double> ring_x_, ring_y_;
  double core_area_px_ = 0, pixel_sr_ = 0;
};

// Core 93 %, the rest as θ^-2.5; strengths from the brightest ring that is there, skies from the outermost.
std::vector<double> SpreadCost::start() const {
  std::vector<double> p(at_.size(), 0.0);
  p.at(at_.core()) = std::log(options_.core_fraction);
  double sum = 0;
  for (size_t n = 0; n < kSpreadNodes; ++n) sum += area_px_[n] * std::pow(nodes_[n] / nodes_[0], -2.5);
  for (size_t n = 0; n < kSpreadNodes; ++n)
    p[at_.node(n)] = std::log((1 - options_.core_fraction) / sum) - 2.5 * std::log(nodes_[n] / nodes_[0]);
  const auto per_lamp = static_cast<size_t>(map_.options.rings);
  for (size_t j = 0; j < at_.lamps; ++j) {
    double sky = data_.sky_unit, best = 0;
    for (size_t k = 0; k < per_lamp; ++k)
      if (data_.used[j * per_lamp + k]) sky = std::min(sky, data_.value[j * per_lamp + k]);
    for (size_t k = 0; k < per_lamp && best <= 0; ++k) {
      const size_t r = j * per_lamp + k;
      if (!data_.used[r]) continue;
      double density = k == 0 ? std::exp(p[at_.core()]) / core_area_px_ : 0;
      if (k > 0)
        for (const NodeShare& share : shares_[r * at_.lamps + j])
          density += share.weight * std::exp(p[at_.node(share.node)]);
      best = std::max(data_.value[r] - sky, 1e-3 * data_.sky_unit) / std::max(density, 1e-12);
    }
    p[at_.strength(j)] = std::log(std::max(best, 1e-6 * data_.sky_unit)) - std::log(transmission_[j]);
    p[at_.sky(j)] = sky / data_.sky_unit;
  }
  return p;
}

// Part of the lamps whose core is unsaturated.
double cores_seen(const photometry::RingMap& map, const RingData& data) {
  const auto per_lamp = static_cast<size_t>(map.options.rings);
  double seen = 0;
  for (size_t r = 0; r < map.rings.size(); r += per_lamp) seen += data.used[r] ? 1 : 0;
  return map.rings.empty() ? 0 : seen * static_cast<double>(per_lamp) / static_cast<double>(map.rings.size());
}

// Of ln strength. Where cores are saturated, all strengths together are as uncertain as the share of the
// light that goes into the core; the scene's κ stands for that, so here counts what a lamp may differ by from
// the rest.
double strength_sigma(const Eigen::MatrixXd& covariance, const photometry::RingMap& map, const RingData& data,
                      const SpreadLayout& at, size_t lamp) {
  const auto per_lamp = static_cast<size_t>(map.options.rings);
  const auto own = static_cast<Eigen::Index>(at.strength(lamp));
  if (data.used[lamp * per_lamp]) return std::sqrt(std::max(0.0, covariance(own, own)));
  Eigen::VectorXd contrast = Eigen::VectorXd::Zero(covariance.rows());
  double glaring = 0;
  for (size_t j = 0; j < at.lamps; ++j) glaring += data.used[j * per_lamp] ? 0 : 1;
  for (size_t j = 0; j < at.lamps; ++j)
    if (!data.used[j * per_lamp]) contrast(static_cast<Eigen::Index>(at.strength(j))) = -1 / glaring;
  contrast(own) += 1;
  return std::sqrt(std::max(0.0, contrast.dot(covariance * contrast)));
}

}  // namespace

LearnedSpread learn_spread(const Camera& camera, const photometry::RingMap& map,
                           std::span<const SceneLamp> lamps, const HaloModel& halo, const RingData& data,
                           double extinction_per_m, const SpreadOptions& given) {
  LearnedSpread learned;
  learned.core_seen = cores_seen(map, data) > kEnoughCores;
  SpreadOptions options = given;
  if (learned.core_seen) options.core_fraction_ln_sigma = 1.0;
  SpreadCost cost(camera, map, lamps, halo, data, extinction_per_m, options);
  std::vector<double> p = cost.start();
  ceres::Problem::Options problem_options;
  problem_options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem problem(problem_options);
  problem.AddResidualBlock(&cost, nullptr, p.data());
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = 200;
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  SolverStop given_up(given.given_up);
  solver.callbacks.push_back(&given_up);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  stop_if_given_up(given.given_up);

  const SpreadLayout& at = cost.layout();
  learned.spread.theta_rad = cost.nodes();
  for (size_t n = 0; n < at.nodes; ++n) learned.spread.ln_density.push_back(p[at.node(n)]);
  learned.spread.core_theta_rad = map.edges_rad[1];
  learned.spread.core_fraction = std::exp(p[at.core()]);
  const Eigen::Index rows = cost.num_residuals(), columns = static_cast<Eigen::Index>(at.size());
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian(rows, columns);
  std::vector<double> residuals(static_cast<size_t>(rows));
  const double* blocks[] = {p.data()};
  double* jacobians[] = {jacobian.data()};
  cost.Evaluate(blocks, residuals.data(), jacobians);
  Eigen::MatrixXd information = jacobian.transpose() * jacobian;
  information.diagonal().array() += 1e-9;
  const Eigen::MatrixXd covariance = information.ldlt().solve(Eigen::MatrixXd::Identity(columns, columns));
  for (size_t j = 0; j < lamps.size(); ++j) {
    learned.ln_strength.push_back(p[at.strength(j)]);
    learned.ln_strength_sigma.push_back(strength_sigma(covariance, map, data, at, j));
    learned.sky.push_back(p[at.sky(j)] * data.sky_unit);
  }
  learned.spread.core_ln_sigma = learned.core_seen ? 0.03 : 0.5;
  int count = 0;
  for (size_t r = 0; r < map.rings.size(); ++r) {
    learned.model.push_back(cost.ring_model(p.data(), r, nullptr));
    if (!data.used[r]) continue;
    const double z = (learned.model[r] - data.value[r]) / data.sigma[r];
    learned.chi2_per_ring += std::min(z * z, 100.0);
    ++count;
  }
  if (count > 0) learned.chi2_per_ring /= count;
  return learned;
}

}  // namespace lampglow::inference
