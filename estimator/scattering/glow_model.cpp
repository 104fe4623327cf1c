#include "estimator/scattering/glow_model.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "estimator/scattering/apsf_series.h"
#include "estimator/scattering/diffusion.h"
#include "estimator/scattering/glow_table.h"
#include "estimator/scattering/single_scattering.h"

namespace lampglow::scattering {
namespace {

constexpr std::array<std::string_view, 4> kNames = {"table", "apsf_series", "single", "diffusion"};

struct Range {
  const char* name;
  double low, high;
};

std::string outside_range(std::string_view model, const Range& range, double value) {
  const double slack = 1e-12 * (1 + range.high);
  if (value >= range.low - slack && value <= range.high + slack) return {};
  char text[160];
  std::snprintf(text, sizeof text, "%s = %.6g is outside the model %.*s's %.6g..%.6g", range.name, value,
                static_cast<int>(model.size()), model.data(), range.low, range.high);
  return text;
}

struct Ranges {
  Range thickness, q, albedo, theta_deg;
};

Ranges ranges_of(GlowModel model) {
  if (model == GlowModel::apsf_series)
    return {{"optical thickness", 1.001, 100}, {"q", 0, 0.99}, {"albedo", 0, 1}, {"theta [deg]", 0, 180}};
  if (model == GlowModel::single)
    return {
        {"optical thickness", 0.001, 20}, {"q", -0.97, 0.97}, {"albedo", 0, 1}, {"theta [deg]", 0.01, 180}};
  return {
      {"optical thickness", 0.001, 100}, {"q", -0.97, 0.97}, {"albedo", 0.01, 1}, {"theta [deg]", 0, 180}};
}

}  // namespace

std::string_view to_string(GlowModel model) {
  return kNames.at(static_cast<std::size_t>(model));
}

std::optional<GlowModel> parse_glow_model(std::string_view name) {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (kNames[i] == name) return static_cast<GlowModel>(i);
  return std::nullopt;
}

std::string outside_glow_model(GlowModel model, double thickness, double q, double albedo,
                               std::span<const double> theta_rad) {
  if (model == GlowModel::table)
    return default_glow_table().domain().outside(thickness, q, albedo, theta_rad);
  if (model == GlowModel::apsf_series && thickness <= 1)
    return "optical thickness = " + std::to_string(thickness) +
           ", but the APSF series converges above 1 only: its terms go as T^-(m+1)";
  const Ranges ranges = ranges_of(model);
  const std::string_view name = to_string(model);
  if (auto why = outside_range(name, ranges.thickness, thickness); !why.empty()) return why;
  if (auto why = outside_range(name, ranges.q, q); !why.empty()) return why;
  if (auto why = outside_range(name, ranges.albedo, albedo); !why.empty()) return why;
  for (const double theta : theta_rad)
    if (auto why = outside_range(name, ranges.theta_deg, theta * 180 / std::numbers::pi); !why.empty())
      return why;
  return {};
}

void glow_profile(GlowModel model, double thickness, double q, double albedo,
                  std::span<const double> theta_rad, std::span<double> total,
                  std::span<double> d_ln_thickness, std::span<double> d_q) {
  if (model == GlowModel::table) {
    default_glow_table().profile(thickness, q, albedo, theta_rad, total, d_ln_thickness, d_q);
    return;
  }
  const std::string outside = outside_glow_model(model, thickness, q, albedo, theta_rad);
  if (!outside.empty()) throw std::domain_error(outside);
  std::vector<GlowRadiance> radiances(theta_rad.size());
  if (model == GlowModel::apsf_series)
    apsf_series(thickness, q, theta_rad, radiances);
  else
    std::transform(theta_rad.begin(), theta_rad.end(), radiances.begin(), [&](double theta) {
      return model == GlowModel::single ? single_scattering(thickness, q, albedo, theta)
                                        : diffusion_radiance(thickness, q, albedo, theta);
    });
  for (std::size_t i = 0; i < theta_rad.size(); ++i) {
    const GlowRadiance& radiance = radiances[i];
    total[i] = radiance.value;
    d_ln_thickness[i] = radiance.d_ln_thickness;
    d_q[i] = radiance.d_q;
  }
}

}  // namespace lampglow::scattering
