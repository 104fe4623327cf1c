#include "estimator/scattering/glow_table.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <stdexcept>

#include "estimator/scattering/glow_table_file.h"

extern "C" {
// glow_table_data.S
extern const std::byte lampglow_glow_table_begin[];
extern const std::byte lampglow_glow_table_end[];
}

namespace lampglow::scattering {
namespace {

// Angles that a caller computed from degrees may differ from the limits by rounding.
constexpr double kRounding = 1e-12;

bool within(double value, double low, double high) {
  return value >= low * (1 - kRounding) && value <= high * (1 + kRounding);
}

std::string describe(const char* name, double value, double low, double high) {
  char text[160];
  std::snprintf(text, sizeof text, "%s = %.6g is outside the glow table's %.6g..%.6g", name, value, low,
                high);
  return text;
}

constexpr std::size_t kMaxThetaCoefficients = 128;
using Row = std::array<double, kMaxThetaCoefficients>;

template <typename Source>
void add_row(Row& sum, const Source* source, double weight, std::size_t count) {
  for (std::size_t j = 0; j < count; ++j) sum[j] += weight * static_cast<double>(source[j]);
}

}  // namespace

bool GlowDomain::contains(double thickness, double q, double albedo) const {
  return within(thickness, thickness_min, thickness_max) && within(q, q_min, q_max) &&
         within(albedo, albedo_min, albedo_max);
}

bool GlowDomain::contains_theta(double theta_rad) const {
  return within(theta_rad, theta_min_rad, theta_max_rad);
}

std::string GlowDomain::outside(double thickness, double q, double albedo,
                                std::span<const double> theta_rad) const {
  if (!within(thickness, thickness_min, thickness_max))
    return describe("optical thickness", thickness, thickness_min, thickness_max);
  if (!within(q, q_min, q_max)) return describe("q", q, q_min, q_max);
  if (!within(albedo, albedo_min, albedo_max)) return describe("albedo", albedo, albedo_min, albedo_max);
  constexpr double degree = std::numbers::pi / 180;
  for (const double theta : theta_rad)
    if (!contains_theta(theta))
      return describe("theta [deg]", theta / degree, theta_min_rad / degree, theta_max_rad / degree);
  return {};
}

double direct_irradiance(double thickness) {
  return std::exp(-thickness) / (4 * std::numbers::pi * thickness * thickness);
}

GlowTable GlowTable::parse(std::span<const std::byte> file) {
  GlowTableContents contents = read_glow_table(file);
  if (contents.axes[kTheta].coefficients() > kMaxThetaCoefficients)
    throw std::runtime_error("glow table: more angles than this program can hold");
  GlowTable table;
  table.axes_ = contents.axes;
  table.single_ = std::move(contents.single);
  table.multiple_ = std::move(contents.multiple);
  // The grid spans the domain exactly.
  const auto& axes = table.axes_;
  GlowDomain& domain = table.domain_;
  domain.albedo_min = 1 - axes[kAlbedo].last() * axes[kAlbedo].last();
  domain.albedo_max = 1 - axes[kAlbedo].first * axes[kAlbedo].first;
  domain.q_min = -std::expm1(-axes[kQ].first);
  domain.q_max = -std::expm1(-axes[kQ].last());
  domain.thickness_min = std::exp(axes[kThickness].first);
  domain.thickness_max = std::exp(axes[kThickness].last());
  domain.theta_min_rad = std::exp(axes[kTheta].first);
  domain.theta_max_rad = std::exp(axes[kTheta].last());
  return table;
}

// Coefficients along θ of ln single and ln multiple and of their derivatives.
struct GlowTable::Rows {
  Row single{}, single_thickness{}, single_q{};
  Row multiple{}, multiple_thickness{}, multiple_q{};
};

GlowTable::Rows GlowTable::contract(double thickness, double q, double albedo, bool derivatives) const {
  const SplineWeights wa = spline_weights(axes_[kAlbedo], std::sqrt(std::max(0.0, 1 - albedo)));
  const SplineWeights wq = spline_weights(axes_[kQ], -std::log1p(-q));
  const SplineWeights wt = spline_weights(axes_[kThickness], std::log(thickness));
  const std::size_t angles = axes_[kTheta].coefficients();
  const std::size_t thickness_stride = angles;
  const std::size_t q_stride = thickness_stride * axes_[kThickness].coefficients();
  const std::size_t albedo_stride = q_stride * axes_[kQ].coefficients();
  Rows rows;
  for (std::size_t i = 0; i < 4; ++i) {
    Row single{}, single_t{}, multiple{}, multiple_t{};
    for (std::size_t j = 0; j < 4; ++j) {
      const std::size_t offset = (wq.index + i) * q_stride + (wt.index + j) * thickness_stride;
      add_row(single, &single_[offset], wt.value[j], angles);
      if (derivatives) add_row(single_t, &single_[offset], wt.slope[j], angles);
      Row at_albedo{};
      const float* cell = &multiple_[wa.index * albedo_stride + offset];
      for (std::size_t m = 0; m < angles; ++m)
        at_albedo[m] = wa.value[0] * static_cast<double>(cell[m]) +
                       wa.value[1] * static_cast<double>(cell[albedo_stride + m]) +
                       wa.value[2] * static_cast<double>(cell[2 * albedo_stride + m]) +
                       wa.value[3] * static_cast<double>(cell[3 * albedo_stride + m]);
      add_row(multiple, at_albedo.data(), wt.value[j], angles);
      if (derivatives) add_row(multiple_t, at_albedo.data(), wt.slope[j], angles);
    }
    add_row(rows.single, single.data(), wq.value[i], angles);
    add_row(rows.multiple, multiple.data(), wq.value[i], angles);
    if (!derivatives) continue;
    add_row(rows.single_q, single.data(), wq.slope[i] / (1 - q), angles);  // d(-ln(1-q))/dq
    add_row(rows.multiple_q, multiple.data(), wq.slope[i] / (1 - q), angles);
    add_row(rows.single_thickness, single_t.data(), wq.value[i], angles);
    add_row(rows.multiple_thickness, multiple_t.data(), wq.value[i], angles);
  }
  return rows;
}

void GlowTable::check(double thickness, double q, double albedo, std::span<const double> theta_rad) const {
  const std::string outside = domain_.outside(thickness, q, albedo, theta_rad);
  if (!outside.empty()) throw std::domain_error(outside);
}

namespace {

double at(const Row& row, const SplineWeights& w) {
  return w.value[0] * row[w.index] + w.value[1] * row[w.index + 1] + w.value[2] * row[w.index + 2] +
         w.value[3] * row[w.index + 3];
}

}  // namespace

void GlowTable::profile(double thickness, double q, double albedo, std::span<const double> theta_rad,
                        std::span<double> total, std::span<double> d_ln_thickness,
                        std::span<double> d_q) const {
  check(thickness, q, albedo, theta_rad);
  const Rows rows = contract(thickness, q, albedo, true);
  for (std::size_t i = 0; i < theta_rad.size(); ++i) {
    const SplineWeights w = spline_weights(axes_[kTheta], std::log(theta_rad[i]));
    const double single = albedo * std::exp(at(rows.single, w));
    const double multiple = albedo * albedo * std::exp(at(rows.multiple, w));
    total[i] = single + multiple;
    d_ln_thickness[i] = single * at(rows.single_thickness, w) + multiple * at(rows.multiple_thickness, w);
    d_q[i] = single * at(rows.single_q, w) + multiple * at(rows.multiple_q, w);
  }
}

void GlowTable::parts(double thickness, double q, double albedo, std::span<const double> theta_rad,
                      std::span<double> single, std::span<double> multiple) const {
  check(thickness, q, albedo, theta_rad);
  const Rows rows = contract(thickness, q, albedo, false);
  for (std::size_t i = 0; i < theta_rad.size(); ++i) {
    const SplineWeights w = spline_weights(axes_[kTheta], std::log(theta_rad[i]));
    single[i] = albedo * std::exp(at(rows.single, w));
    multiple[i] = albedo * albedo * std::exp(at(rows.multiple, w));
  }
}

// Of one part of the light, by angle: its logarithm and that one's derivatives.
struct GlowAtAngles::Sums {
  std::vector<double> value, thickness, q, by_thickness, slope_thickness;
  explicit Sums(std::size_t angles)
      : value(angles), thickness(angles), q(angles), by_thickness(angles), slope_thickness(angles) {}
};

GlowAtAngles::GlowAtAngles(const GlowTable& table, double albedo, std::span<const double> theta_rad)
    : domain_(table.domain_),
      q_axis_(table.axes_[GlowTable::kQ]),
      thickness_axis_(table.axes_[GlowTable::kThickness]),
      albedo_(albedo),
      angles_(theta_rad.size()) {
  table.check(domain_.thickness_min, domain_.q_min, albedo, theta_rad);
  const SplineWeights wa =
      spline_weights(table.axes_[GlowTable::kAlbedo], std::sqrt(std::max(0.0, 1 - albedo)));
  const std::size_t columns = table.axes_[GlowTable::kTheta].coefficients();
  const std::size_t rows = q_axis_.coefficients() * thickness_axis_.coefficients();
  for (std::size_t row = 0; row < rows; ++row) {
    Row multiple{}, single{};
    for (std::size_t a = 0; a < 4; ++a)
      add_row(multiple, &table.multiple_[((wa.index + a) * rows + row) * columns], wa.value[a], columns);
    add_row(single, &table.single_[row * columns], 1.0, columns);
    for (const double theta : theta_rad) {
      const SplineWeights w = spline_weights(table.axes_[GlowTable::kTheta], std::log(theta));
      single_.push_back(at(single, w));
      multiple_.push_back(at(multiple, w));
    }
  }
}

void GlowAtAngles::contract(const std::vector<double>& coefficients, double thickness, double q,
                            Sums& sums) const {
  const SplineWeights wq = spline_weights(q_axis_, -std::log1p(-q));
  const SplineWeights wt = spline_weights(thickness_axis_, std::log(thickness));
  for (auto* sum : {&sums.value, &sums.thickness, &sums.q}) std::fill(sum->begin(), sum->end(), 0.0);
  double* by_thickness = sums.by_thickness.data();
  double* slope_thickness = sums.slope_thickness.data();
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t stride = angles_;
    const double* cell = &coefficients[((wq.index + i) * thickness_axis_.coefficients() + wt.index) * stride];
    const double value = wq.value[i], slope = wq.slope[i] / (1 - q);  // d(-ln(1-q))/dq
    for (std::size_t n = 0; n < angles_; ++n) {
      by_thickness[n] = wt.value[0] * cell[n] + wt.value[1] * cell[stride + n] +
                        wt.value[2] * cell[2 * stride + n] + wt.value[3] * cell[3 * stride + n];
      slope_thickness[n] = wt.slope[0] * cell[n] + wt.slope[1] * cell[stride + n] +
                           wt.slope[2] * cell[2 * stride + n] + wt.slope[3] * cell[3 * stride + n];
    }
    for (std::size_t n = 0; n < angles_; ++n) {
      sums.value[n] += value * by_thickness[n];
      sums.thickness[n] += value * slope_thickness[n];
      sums.q[n] += slope * by_thickness[n];
    }
  }
}

void GlowAtAngles::profile(double thickness, double q, std::span<double> total,
                           std::span<double> d_ln_thickness, std::span<double> d_q) const {
  if (const std::string outside = domain_.outside(thickness, q, albedo_, {}); !outside.empty())
    throw std::domain_error(outside);
  Sums single(angles_), multiple(angles_);
  contract(single_, thickness, q, single);
  contract(multiple_, thickness, q, multiple);
  for (std::size_t n = 0; n < angles_; ++n) {
    single.value[n] = albedo_ * std::exp(single.value[n]);
    multiple.value[n] = albedo_ * albedo_ * std::exp(multiple.value[n]);
    total[n] = single.value[n] + multiple.value[n];
  }
  for (std::size_t n = 0; n < d_q.size(); ++n) {
    d_ln_thickness[n] = single.value[n] * single.thickness[n] + multiple.value[n] * multiple.thickness[n];
    d_q[n] = single.value[n] * single.q[n] + multiple.value[n] * multiple.q[n];
  }
}

const GlowTable& default_glow_table() {
  static const GlowTable table =
      GlowTable::parse(std::span(lampglow_glow_table_begin, lampglow_glow_table_end));
  return table;
}

}  // namespace lampglow::scattering
