#include "estimator/inference/combine.h"

#include <algorithm>
#include <cmath>

namespace lampglow::inference {
namespace {

constexpr double k95 = 1.96;

// Smooth from 1 at `full` to 0 at `none`.
double fade(double altitude_deg, double full_deg, double none_deg) {
  const double x = std::clamp((altitude_deg - none_deg) / (full_deg - none_deg), 0.0, 1.0);
  return x * x * (3 - 2 * x);
}

bool has_value(const Observation& o) {
  return o.extinction_per_m && o.limit == Limit::none;
}

// One standard deviation of ln σ from the 95 % bounds; a side that is open counts as the other, or as wide.
double ln_sd(const Observation& o) {
  const double ln = std::log(*o.extinction_per_m);
  const double down = o.extinction_low_per_m ? ln - std::log(*o.extinction_low_per_m) : 0;
  const double up = o.extinction_high_per_m ? std::log(*o.extinction_high_per_m) - ln : 0;
  const double half = down > 0 && up > 0 ? 0.5 * (down + up) : std::max(down, up);
  return half > 0 ? half / k95 : 1.0;
}

// The tighter of two limits of one kind: "above" is tighter at the smaller σ, "below" at the greater.
const Observation& tighter(const Observation& a, const Observation& b) {
  const bool a_smaller = *a.extinction_per_m < *b.extinction_per_m;
  return (a.limit == Limit::above) == a_smaller ? a : b;
}

bool contradicts(const Observation& limit, const Observation& value) {
  return limit.limit == Limit::above
             ? value.extinction_low_per_m.value_or(*value.extinction_per_m) > *limit.extinction_per_m
             : value.extinction_high_per_m.value_or(*value.extinction_per_m) < *limit.extinction_per_m;
}

Observation average(const Observation& glow, const Observation& contrast, double glow_part,
                    double contrast_part) {
  const double g = std::log(*glow.extinction_per_m), c = std::log(*contrast.extinction_per_m);
  const double weight_g = glow_part / std::pow(ln_sd(glow), 2),
               weight_c = contrast_part / std::pow(ln_sd(contrast), 2);
  const double total = weight_g + weight_c, mean = (weight_g * g + weight_c * c) / total;
  // Birge: the error grows by the root of χ² where the two disagree.
  const double chi2 = weight_g * std::pow(g - mean, 2) + weight_c * std::pow(c - mean, 2);
  const double sd = std::sqrt(std::max(1.0, chi2) / total);
  Observation result = weight_g >= weight_c ? glow : contrast;
  result.extinction_per_m = std::exp(mean);
  result.extinction_low_per_m = std::exp(mean - k95 * sd);
  result.extinction_high_per_m = std::exp(mean + k95 * sd);
  return result;
}

Observation choose(const Observation& glow, const Observation& contrast, double glow_part,
                   double contrast_part) {
  if (!contrast.extinction_per_m || contrast_part <= 0) return glow.extinction_per_m ? glow : contrast;
  if (!glow.extinction_per_m || glow_part <= 0) return contrast;
  if (has_value(glow) && has_value(contrast)) return average(glow, contrast, glow_part, contrast_part);
  if (has_value(glow) || has_value(contrast)) {
    const Observation& value = has_value(glow) ? glow : contrast;
    const Observation& limit = has_value(glow) ? contrast : glow;
    const double value_part = has_value(glow) ? glow_part : contrast_part;
    const double limit_part = has_value(glow) ? contrast_part : glow_part;
    // A limit from a model that does not fit its own picture undoes no value that does fit.
    const bool doubtful = limit.quality.has(Quality::poor_fit) && !value.quality.has(Quality::poor_fit);
    return contradicts(limit, value) && limit_part > value_part && !doubtful ? limit : value;
  }
  if (glow.limit == contrast.limit) return tighter(glow, contrast);
  return glow_part >= contrast_part ? glow : contrast;
}

}  // namespace

double contrast_weight(std::optional<double> altitude_deg, const CombineOptions& options) {
  return altitude_deg ? fade(*altitude_deg, options.contrast_full_deg, options.contrast_none_deg) : 1.0;
}

double glow_weight(std::optional<double> altitude_deg, const CombineOptions& options) {
  return altitude_deg ? fade(*altitude_deg, options.glow_full_deg, options.glow_none_deg) : 1.0;
}

Observation combine(const Observation& glow, const Observation& contrast, std::optional<double> altitude_deg,
                    const CombineOptions& options) {
  Observation result =
      choose(glow, contrast, glow_weight(altitude_deg, options), contrast_weight(altitude_deg, options));
  result.quality.set(glow.quality);
  result.quality.set(contrast.quality);
  // Only the answer's own limit is flagged, not that of the method which was outweighed.
  if (result.limit != Limit::above) result.quality.clear(Quality::limit_above);
  if (result.limit != Limit::below) result.quality.clear(Quality::limit_below);
  return result;
}

}  // namespace lampglow::inference
