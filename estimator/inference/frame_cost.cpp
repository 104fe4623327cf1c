#include "estimator/inference/frame_cost.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numeric>

#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

constexpr double kSkySigma = 30.0;
constexpr double kCoreTail =
    8;  // instead of ring_tail: the backgrounds of many rings must not outvote a core

// A residual's derivative with respect to one parameter.
struct Slope {
  size_t parameter;
  double value;
};

double square(double x) {
  return x * x;
}

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

// A lamp's core is its first ring.
bool starts_lamp(const Scene& scene, size_t ring) {
  return ring == 0 || scene.lamp_of_ring(ring) != scene.lamp_of_ring(ring - 1);
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

FrameCost::FrameCost(const Scene& scene, const HaloModel& halo, const RingData& data,
                     const FitOptions& options)
    : scene_(scene), halo_(halo), data_(data), options_(options), at_(scene.lamps().size()) {
  for (size_t r = 0; r < scene.ring_count(); ++r)
    if (data.used[r]) rings_.push_back(r);
  for (const SceneLamp& lamp : scene.lamps()) guests_ += lamp.guest() ? 1 : 0;
}

double FrameCost::ring_residual(size_t r, double model, double& slope) const {
  // Of one exposure that is not told (8 bits, saturated) the core is the least trusted ring.
  const double tail = options_.gain_known && starts_lamp(scene_, r) ? kCoreTail : options_.ring_tail;
  const double residual = soften((model - data_.value[r]) / data_.sigma[r], tail, slope);
  slope /= data_.sigma[r];
  return residual;
}

void FrameCost::evaluate(const double* p, double* residuals, double* jacobian) const {
  const size_t columns = at_.size();
  std::vector<int> column_of(jacobian ? columns : 0);
  std::iota(column_of.begin(), column_of.end(), 0);
  scene_.evaluate(halo_, {p, columns}, data_.lit, data_.sky_unit, {rings_, column_of, columns}, output_);
  size_t row = 0;
  for (; row < rings_.size(); ++row) {
    double slope = 0;
    residuals[row] = ring_residual(rings_[row], output_.model[row], slope);
    for (size_t c = 0; c < column_of.size(); ++c)
      jacobian[row * columns + c] = output_.jacobian[row * columns + c] * slope;
  }
  if (jacobian) std::fill(jacobian + row * columns, jacobian + residual_count() * columns, 0.0);
  each_prior(p, [&](double residual, std::initializer_list<Slope> slopes) {
    residuals[row] = residual;
    if (jacobian)
      for (const Slope& slope : slopes) jacobian[row * columns + slope.parameter] = slope.value;
    ++row;
  });
}

double FrameCost::cost(const double* p) const {
  scene_.evaluate(halo_, {p, at_.size()}, data_.lit, data_.sky_unit, {rings_, {}, 0}, output_);
  double sum = 0, slope = 0;
  for (size_t i = 0; i < rings_.size(); ++i) sum += square(ring_residual(rings_[i], output_.model[i], slope));
  each_prior(p, [&](double residual, std::initializer_list<Slope>) { sum += square(residual); });
  return sum / 2;
}

double FrameCost::cost_of_model(const double* p, std::span<const double> model) const {
  double sum = 0, slope = 0;
  for (const size_t r : rings_) sum += square(ring_residual(r, model[r], slope));
  each_prior(p, [&](double residual, std::initializer_list<Slope>) { sum += square(residual); });
  return sum / 2;
}

NormalEquations FrameCost::normal_equations(const double* p, std::span<const int> active) const {
  const size_t n = active.size();
  NormalEquations out{std::vector<double>(n * n), std::vector<double>(n), 0};
  add_rings(p, active, out);
  std::vector<int> index_of(at_.size(), -1);
  for (size_t i = 0; i < n; ++i) index_of[static_cast<size_t>(active[i])] = static_cast<int>(i);
  each_prior(p, [&](double residual, std::initializer_list<Slope> slopes) {
    out.cost += square(residual) / 2;
    for (const Slope& a : slopes) {
      if (index_of[a.parameter] < 0) continue;
      const auto i = static_cast<size_t>(index_of[a.parameter]);
      out.gradient[i] += a.value * residual;
      for (const Slope& b : slopes)
        if (index_of[b.parameter] >= 0)
          out.information[i * n + static_cast<size_t>(index_of[b.parameter])] += a.value * b.value;
    }
  });
  return out;
}

// All but the skies have dense columns: their part is one symmetric product.
void FrameCost::add_rings(const double* p, std::span<const int> active, NormalEquations& out) const {
  const size_t n = active.size(), rows = rings_.size();
  size_t dense = 0;
  std::vector<int> column_of(at_.size(), -1);
  for (; dense < n && static_cast<size_t>(active[dense]) < at_.sky(0); ++dense)
    column_of[static_cast<size_t>(active[dense])] = static_cast<int>(dense);
  std::vector<int> sky_of(at_.lamps, -1);
  for (size_t i = dense; i < n; ++i)
    sky_of[static_cast<size_t>(active[i]) - at_.sky(0)] = static_cast<int>(i);
  scene_.evaluate(halo_, {p, at_.size()}, data_.lit, data_.sky_unit, {rings_, column_of, dense}, output_);
  using Square = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const auto size = static_cast<Eigen::Index>(n), wide = static_cast<Eigen::Index>(dense);
  Eigen::Map<Square> information(out.information.data(), size, size);
  Eigen::Map<Square> jacobian(output_.jacobian.data(), static_cast<Eigen::Index>(rows), wide);
  Eigen::Map<Eigen::VectorXd> gradient(out.gradient.data(), size);
  const double roof = Scene::roof_transmission(p[Layout::ln_sigma]);
  for (size_t i = 0; i < rows; ++i) {
    double slope = 0;
    const double residual = ring_residual(rings_[i], output_.model[i], slope);
    out.cost += square(residual) / 2;
    auto row = jacobian.row(static_cast<Eigen::Index>(i));
    row *= slope;
    gradient.head(wide) += residual * row.transpose();
    const int sky = sky_of[static_cast<size_t>(scene_.lamp_of_ring(rings_[i]))];
    if (sky < 0) continue;
    const double by_sky = slope * data_.sky_unit * scene_.sky_factor(rings_[i], roof);
    information.row(sky).head(wide) += by_sky * row;
    information(sky, sky) += by_sky * by_sky;
    gradient(sky) += by_sky * residual;
  }
  information.topLeftCorner(wide, wide).selfadjointView<Eigen::Lower>().rankUpdate(jacobian.transpose());
  information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
}

// What is seen of each guest's beam.
template <typename Sink>
void FrameCost::each_guest(const double* p, Sink&& sink) const {
  for (size_t j = 0; j < at_.lamps; ++j) {
    const SceneLamp& lamp = scene_.lamps()[j];
    if (!lamp.guest()) continue;
    const double thickness =
        std::exp(p[Layout::ln_sigma] + p[at_.ln_distance(j)]) * lamp.distance_m.value_or(1.0);
    const double ln_beam = p[Layout::ln_gain] + lamp.ln_strength + p[at_.ln_strength(j)] - thickness;
    const double s = lamp.ln_beam_sigma;
    sink((ln_beam - *lamp.ln_beam) / s, {{Layout::ln_gain, 1 / s},
                                         {at_.ln_strength(j), 1 / s},
                                         {Layout::ln_sigma, -thickness / s},
                                         {at_.ln_distance(j), -thickness / s}});
  }
}

template <typename Sink>
void FrameCost::each_prior(const double* p, Sink&& sink) const {
  constexpr double kStep = 1e-4;
  const double ln_sigma = p[Layout::ln_sigma];
  const auto q_off = [&](double at) {
    return (p[Layout::q] - prior_q(at, options_)) / prior_q_sigma(at, options_);
  };
  sink(q_off(ln_sigma),
       {{Layout::q, 1 / prior_q_sigma(ln_sigma, options_)},
        {Layout::ln_sigma, (q_off(ln_sigma + kStep) - q_off(ln_sigma - kStep)) / (2 * kStep)}});
  const auto pull = [&](size_t parameter, double mean, double sigma, bool heavy_tail) {
    double slope = sigma > 0 ? 1.0 : 0.0;
    double r = sigma > 0 ? (p[parameter] - mean) / sigma : 0.0;
    if (heavy_tail && sigma > 0) r = soften(r, options_.prior_tail, slope);
    sink(r, {{parameter, sigma > 0 ? slope / sigma : 0.0}});
  };
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
  each_guest(p, sink);
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

}  // namespace lampglow::inference
