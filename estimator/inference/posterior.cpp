#include "estimator/inference/posterior.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace lampglow::inference {
namespace {

constexpr double kTwoSided95 = 1.92;  // −Δ ln p at 1.96 σ
constexpr double kOneSided95 = 1.353;
constexpr double kOneSidedShare = 0.95;
constexpr double kOneSigma = 0.5;

// Where −ln p rises for good by `rise` above its least on one side (step +1 or −1), beyond any rival mode;
// empty if it never does. Between the points √rise goes linearly, as a normal's does.
std::optional<double> crossing(std::span<const PosteriorPoint> p, size_t best, int step, double rise) {
  const double least = p[best].minus_ln_probability, bar = std::sqrt(rise);
  const auto root = [&](size_t i) { return std::sqrt(std::max(0.0, p[i].minus_ln_probability - least)); };
  size_t outer = step > 0 ? p.size() - 1 : 0;
  if (root(outer) < bar) return std::nullopt;
  for (;;) {
    const size_t inner = step > 0 ? outer - 1 : outer + 1;
    if (root(inner) < bar) {
      const double f = (bar - root(inner)) / std::max(root(outer) - root(inner), 1e-12);
      return p[inner].ln_sigma + std::clamp(f, 0.0, 1.0) * (p[outer].ln_sigma - p[inner].ln_sigma);
    }
    outer = inner;
  }
}

// Where 95 % of the probability lies before, going with step +1 or −1. A rival mode that the rise alone steps
// over still counts for what it weighs.
double quantile(std::span<const PosteriorPoint> p, size_t best, int step, double scale) {
  const auto weight = [&](size_t i) {
    return std::exp(-(p[i].minus_ln_probability - p[best].minus_ln_probability) * scale);
  };
  const auto between = [&](size_t i) {  // of points i and i + 1
    return 0.5 * (weight(i) + weight(i + 1)) * (p[i + 1].ln_sigma - p[i].ln_sigma);
  };
  double left = 0;
  for (size_t i = 0; i + 1 < p.size(); ++i) left += between(i);
  left *= 1 - kOneSidedShare;
  for (size_t n = 0; n + 1 < p.size(); ++n) {
    const size_t i = step > 0 ? p.size() - 2 - n : n;
    if (between(i) >= left) {
      const double f = left / std::max(between(i), 1e-300);
      return step > 0 ? std::lerp(p[i + 1].ln_sigma, p[i].ln_sigma, f)
                      : std::lerp(p[i].ln_sigma, p[i + 1].ln_sigma, f);
    }
    left -= between(i);
  }
  return p[best].ln_sigma;
}

}  // namespace

SigmaBounds sigma_bounds(std::span<const PosteriorPoint> p, const BoundsOptions& options) {
  if (p.empty()) throw std::invalid_argument("sigma_bounds: posterior has no points");
  const double scale = 1.0 / (options.inflate * options.inflate);
  const auto best =
      static_cast<size_t>(std::min_element(p.begin(), p.end(),
                                           [](const auto& a, const auto& b) {
                                             return a.minus_ln_probability < b.minus_ln_probability;
                                           }) -
                          p.begin());
  SigmaBounds bounds;
  bounds.value = std::exp(p[best].ln_sigma);
  const auto low = crossing(p, best, -1, kTwoSided95 / scale);
  const auto high = crossing(p, best, +1, kTwoSided95 / scale);
  const auto low1 = crossing(p, best, -1, kOneSigma / scale),
             high1 = crossing(p, best, +1, kOneSigma / scale);
  bounds.ln_sd = 0.5 * (high1.value_or(p.back().ln_sigma) - low1.value_or(p.front().ln_sigma));
  const bool narrow = low && high && std::exp(*high - *low) <= options.widest_ratio;
  if (narrow || (!low && !high)) {
    const double value = p[best].ln_sigma, floor = 1.96 * options.ln_floor;
    if (low) bounds.low = std::exp(value - std::hypot(value - *low, floor));
    if (high) bounds.high = std::exp(value + std::hypot(*high - value, floor));
    bounds.ln_sd = std::hypot(bounds.ln_sd, options.ln_floor);
    return bounds;
  }
  // Too wide for a value: a limit. "Below" only helps where visibility is restricted; in clear air the bound
  // towards thinner air may well be the nearer one and says nothing ("below 230 km").
  const double to_low = low ? p[best].ln_sigma - *low : 1e9, to_high = high ? *high - p[best].ln_sigma : 1e9;
  const bool restricted = low && std::exp(*low) >= kMorTimesExtinction / options.restricted_mor_m;
  const bool above = high && (to_high <= to_low || !restricted);
  bounds.limit = above ? Limit::above : Limit::below;
  const int step = above ? +1 : -1;  // the more careful of the two
  const double edge = crossing(p, best, step, kOneSided95 / scale).value_or(p[best].ln_sigma);
  const double share = quantile(p, best, step, scale);
  bounds.value = std::exp(above ? std::max(edge, share) : std::min(edge, share));
  (above ? bounds.high : bounds.low) = bounds.value;
  return bounds;
}

}  // namespace lampglow::inference
