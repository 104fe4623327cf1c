#include "estimator/scattering/medium.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace lampglow::scattering {

void check(const Medium& medium) {
  const auto refuse = [](const char* field, double value, const char* constraint) {
    throw std::invalid_argument(std::string("medium: ") + field + " = " + std::to_string(value) +
                                ", must be " + constraint);
  };
  if (!(medium.extinction_per_m > 0) || !std::isfinite(medium.extinction_per_m))
    refuse("extinction_per_m", medium.extinction_per_m, "positive");
  if (!(medium.albedo >= 0 && medium.albedo <= 1)) refuse("albedo", medium.albedo, "within 0..1");
  if (!(std::abs(medium.q) < 1)) refuse("q", medium.q, "between -1 and 1");
}

double optical_thickness(double extinction_per_m, double distance_m) {
  return extinction_per_m * distance_m;
}

double visibility_two_percent_m(double extinction_per_m) {
  return -std::log(0.02) / extinction_per_m;
}

double meteorological_optical_range_m(double extinction_per_m) {
  return -std::log(0.05) / extinction_per_m;
}

double extinction_from_mor_per_m(double mor_m) {
  return -std::log(0.05) / mor_m;
}

}  // namespace lampglow::scattering
