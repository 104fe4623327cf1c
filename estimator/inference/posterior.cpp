#include "estimator/inference/posterior.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace lampglow::inference {
namespace {

constexpr double kTwoSided95 = 1.92;  // −Δ ln p at 1.96 σ
constexpr double kOneSided95 = 1.353;
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
    if (low) bounds.low = std::exp(*low);
    if (high) bounds.high = std::exp(*high);
    return bounds;
  }
  // Too wide for a value. Whichever side holds better is the limit.
  const double to_low = low ? p[best].ln_sigma - *low : 1e9, to_high = high ? *high - p[best].ln_sigma : 1e9;
  const bool above = to_high <= to_low;
  bounds.limit = above ? Limit::above : Limit::below;
  const auto edge = crossing(p, best, above ? +1 : -1, kOneSided95 / scale);
  bounds.value = std::exp(edge.value_or(p[best].ln_sigma));
  (above ? bounds.high : bounds.low) = bounds.value;
  return bounds;
}

}  // namespace lampglow::inference
