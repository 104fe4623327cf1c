// What the rings read: the part of the scene that a fit evaluates again and again.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <numeric>
#include <span>

#include "estimator/inference/luminaire.h"
#include "estimator/inference/scene.h"
#include "estimator/photometry/vectorized.h"

namespace lampglow::inference {
namespace {

// G and its derivatives at the nodes. Below the table's least T single scattering is all there is, so that g
// goes as 1/T; beyond its greatest nothing is left of the lamp and the last slope carries on to nothing.
struct Glow {
  std::array<double, kSceneNodes> value{}, d_ln_thickness{}, d_q{};
};

void glow_at_nodes(const HaloModel& model, double thickness, double q, bool want_slopes, Glow& glow) {
  const double inside = std::clamp(thickness, model.min_thickness(), model.max_thickness());
  const double clamped_q = std::clamp(q, 0.0, model.max_q());
  const size_t slopes = want_slopes || thickness > inside ? kSceneNodes : 0;
  model.profile(inside, clamped_q, scene_nodes_rad(), glow.value,
                std::span(glow.d_ln_thickness).first(slopes), std::span(glow.d_q).first(slopes));
  const double t2 = inside * inside;
  const double ln_ratio = std::log(thickness / inside);
  if (ln_ratio == 0) {
    for (size_t n = 0; n < kSceneNodes; ++n) {
      glow.value[n] *= t2;
      glow.d_ln_thickness[n] = 2.0 * glow.value[n] + t2 * glow.d_ln_thickness[n];
      glow.d_q[n] *= t2;
    }
    return;
  }
  for (size_t n = 0; n < kSceneNodes; ++n) {
    const double v = glow.value[n] * t2;
    const double slope = v != 0 ? (2.0 * v + t2 * glow.d_ln_thickness[n]) / v : 0;
    const double power = thickness < inside ? 1.0 : std::min(slope, -2.0);
    const double factor = std::exp(power * ln_ratio);
    glow.value[n] = v * factor;
    glow.d_ln_thickness[n] = power * glow.value[n];
    glow.d_q[n] *= t2 * factor;
  }
}

// A node's numbers, side by side: one weight then serves all four. Without a Jacobian the halo stands alone.
enum Term : size_t { kHalo, kThickness, kQ, kShape, kTerms };

// Each node's numbers become those after the lens: column by column of the convolution, four columns at once.
template <size_t kCount>
[[gnu::always_inline]] inline void convolve(const std::vector<double>& convolution, double* terms) {
  std::array<double, kSceneNodes * kCount> out{};
  for (size_t n = 0; n < kSceneNodes; n += 4) {
    const double* column = &convolution[n * kSceneNodes];
    const double* in = &terms[n * kCount];
    for (size_t m = 0; m < kSceneNodes; ++m)
      for (size_t t = 0; t < kCount; ++t)
        out[m * kCount + t] = out[m * kCount + t] + column[m] * in[t] +
                              column[kSceneNodes + m] * in[kCount + t] +
                              column[2 * kSceneNodes + m] * in[2 * kCount + t] +
                              column[3 * kSceneNodes + m] * in[3 * kCount + t];
  }
  std::copy(out.begin(), out.end(), terms);
}
static_assert(kSceneNodes % 4 == 0);

LAMPGLOW_VECTORIZED void convolve_halo(const std::vector<double>& convolution, double* terms) {
  convolve<1>(convolution, terms);
}

LAMPGLOW_VECTORIZED void convolve_terms(const std::vector<double>& convolution, double* terms) {
  convolve<kTerms>(convolution, terms);
}

// Σ weight · node, term by term.
LAMPGLOW_VECTORIZED std::array<double, kTerms> weighted_terms(std::span<const double> weights,
                                                              const double* nodes) {
  std::array<double, kTerms> sum{};
  for (size_t n = 0; n < weights.size(); ++n)
    for (size_t t = 0; t < kTerms; ++t) sum[t] += weights[n] * nodes[n * kTerms + t];
  return sum;
}

// Of what stands before the sky; its distance is a guess, see RingErrors::of_pattern.
double roof_thickness(double ln_sigma) {
  constexpr double kRoofDistance_m = 400;
  return std::exp(ln_sigma) * kRoofDistance_m;
}

}  // namespace

double Scene::roof_transmission(double ln_sigma) {
  return std::exp(-roof_thickness(ln_sigma));
}

double Scene::sky_factor(size_t ring, double roof_transmission) const {
  return pattern_.sky.empty() ? 1.0 : 1.0 + pattern_.sky[ring] * roof_transmission;
}

// One lamp's light in these parameters: its beam, and at every node its halo after the lens with what the
// Jacobian needs.
struct Scene::LampTerms {
  size_t lamp = 0;
  double beam = 0, thickness = 0;
  std::array<double, kSceneNodes * kTerms> nodes{};
};

// One ring's row of the Jacobian.
struct Scene::Row {
  double* values;  // null: not wanted
  const Wanted& wanted;
  Layout at;
  void add(size_t parameter, double value) const {
    if (const int column = wanted.column_of[parameter]; column >= 0) values[column] += value;
  }
};

void Scene::evaluate(const HaloModel& halo, std::span<const double> p, std::span<const char> lit,
                     double sky_unit, Output& output, bool want_jacobian) const {
  std::vector<size_t> rings(rings_);
  std::iota(rings.begin(), rings.end(), size_t{0});
  std::vector<int> columns(want_jacobian ? Layout(lamps_.size()).size() : 0);
  std::iota(columns.begin(), columns.end(), 0);
  evaluate(halo, p, lit, sky_unit, {rings, columns, columns.size()}, output);
}

void Scene::evaluate(const HaloModel& halo, std::span<const double> p, std::span<const char> lit,
                     double sky_unit, const Wanted& wanted, Output& output) const {
  const bool want_jacobian = !wanted.column_of.empty();
  std::vector<LampTerms> terms;
  for (size_t j = 0; j < lamps_.size(); ++j)
    if (lit[j]) terms.push_back(terms_of(j, halo, p, want_jacobian));
  const Layout at(lamps_.size());
  const double kappa = std::exp(p[Layout::ln_kappa]);
  const double thickness = roof_thickness(p[Layout::ln_sigma]),
               transmission = roof_transmission(p[Layout::ln_sigma]);
  output.model.resize(wanted.rings.size());
  output.jacobian.assign(want_jacobian ? wanted.rings.size() * wanted.columns : 0, 0.0);
  for (size_t i = 0; i < wanted.rings.size(); ++i) {
    const size_t r = wanted.rings[i];
    const auto own = static_cast<size_t>(owner_[r]);
    Row row{want_jacobian ? &output.jacobian[i * wanted.columns] : nullptr, wanted, at};
    double light = 0;
    for (const LampTerms& term : terms) light += add_light(r, term, kappa, row);
    const double smooth_sky =
        sky_unit * (p[at.sky(own)] + p[Layout::slope_x] * ring_x_[r] + p[Layout::slope_y] * ring_y_[r]);
    const double factor = sky_factor(r, transmission);
    output.model[i] = light + factor * smooth_sky;
    if (!row.values) continue;
    row.add(Layout::ln_gain, light);
    row.add(Layout::ln_sigma, (1.0 - factor) * smooth_sky * thickness);
    row.add(Layout::slope_x, factor * sky_unit * ring_x_[r]);
    row.add(Layout::slope_y, factor * sky_unit * ring_y_[r]);
    row.add(at.sky(own), factor * sky_unit);
  }
}

std::vector<double> Scene::lights(const HaloModel& halo, std::span<const double> p,
                                  std::span<const char> lit) const {
  const Wanted nothing{};
  Row row{nullptr, nothing, Layout(lamps_.size())};
  const double kappa = std::exp(p[Layout::ln_kappa]);
  std::vector<double> light(rings_ * lamps_.size());
  for (size_t j = 0; j < lamps_.size(); ++j) {
    if (!lit[j]) continue;
    const LampTerms term = terms_of(j, halo, p, false);
    for (size_t r = 0; r < rings_; ++r) light[r * lamps_.size() + j] = add_light(r, term, kappa, row);
  }
  return light;
}

Scene::LampTerms Scene::terms_of(size_t j, const HaloModel& halo, std::span<const double> p,
                                 bool want_jacobian) const {
  const Layout at(lamps_.size());
  LampTerms term;
  term.lamp = j;
  const double kappa = lamps_[j].core_seen ? 1.0 : std::exp(p[Layout::ln_kappa]);
  const double strength =
      std::exp(p[Layout::ln_gain]) * std::exp(lamps_[j].ln_strength + p[at.ln_strength(j)]);
  term.thickness = std::exp(p[Layout::ln_sigma] + p[at.ln_distance(j)]) * lamps_[j].distance_m.value_or(1.0);
  term.beam = strength * std::exp(-std::min(term.thickness, 700.0));
  const double ln_halo = lamps_[j].ln_halo * luminaire_weight(p[Layout::q]) + p[at.ln_halo(j)];
  const double scale = strength * kappa * std::exp(ln_halo) * 4.0 * std::numbers::pi * solid_angle_[j];
  const double by_luminaire = lamps_[j].ln_halo * kLuminaireWeightSlope;
  Glow glow;
  glow_at_nodes(halo, std::max(term.thickness, 1e-9), p[Layout::q], want_jacobian, glow);
  for (size_t n = 0; n < kSceneNodes; ++n) {
    const double shape = 1.0 + p[Layout::emission] * emission_shape_[n];
    double* node = &term.nodes[n * (want_jacobian ? size_t{kTerms} : 1)];
    node[kHalo] = scale * glow.value[n] * shape;
    if (!want_jacobian) continue;
    node[kThickness] = scale * glow.d_ln_thickness[n] * shape;
    node[kQ] = scale * (glow.d_q[n] + by_luminaire * glow.value[n]) * shape;
    node[kShape] = scale * glow.value[n] * emission_shape_[n];
  }
  if (want_jacobian)
    spread_halo(term.nodes.data());
  else
    convolve_halo(convolution_, term.nodes.data());
  return term;
}

void Scene::spread_halo(double* terms) const {
  convolve_terms(convolution_, terms);
}

// One lamp's light in one ring, and its part of the ring's row.
double Scene::add_light(size_t r, const LampTerms& term, double kappa, Row& row) const {
  const size_t j = term.lamp;
  const Range& range = ranges_[r * lamps_.size() + j];
  const std::span<const double> weights = std::span(weights_).subspan(range.offset, range.count);
  const double* node = &term.nodes[range.start * (row.values ? size_t{kTerms} : 1)];
  const bool by_glare = !lamps_[j].core_seen;
  const bool core = by_glare && is_core_[r] && owner_[r] == static_cast<int>(j);
  const double lens = pattern_.lens.empty() ? 1.0 : 1.0 + pattern_.lens[r];
  const double beam = lens * term.beam * direct(r, j) * (core ? kappa : 1.0);
  if (!row.values) return beam + std::inner_product(weights.begin(), weights.end(), node, 0.0);
  const std::array<double, kTerms> sum = weighted_terms(weights, node);
  const double d_thickness = sum[kThickness] - term.thickness * beam;
  row.add(Layout::ln_sigma, d_thickness);
  row.add(Layout::q, sum[kQ]);
  if (by_glare) row.add(Layout::ln_kappa, sum[kHalo] + (core ? beam : 0.0));
  row.add(Layout::emission, sum[kShape]);
  row.add(row.at.ln_strength(j), beam + sum[kHalo]);
  row.add(row.at.ln_halo(j), sum[kHalo]);
  row.add(row.at.ln_distance(j), d_thickness);
  return beam + sum[kHalo];
}

}  // namespace lampglow::inference
