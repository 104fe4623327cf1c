#include "estimator/scattering/attenuation.h"

#include <cmath>

namespace lampglow::scattering {

double bouguer_transmission(double thickness) {
  return std::exp(-thickness);
}

double bouguer_irradiance(double intensity, double distance_m, double extinction_per_m) {
  return intensity * bouguer_transmission(extinction_per_m * distance_m) / (distance_m * distance_m);
}

double koschmieder_airlight(double horizon, double distance_m, double extinction_per_m) {
  return -horizon * std::expm1(-extinction_per_m * distance_m);  // expm1: exact for thin air
}

double attenuation_with_airlight(double object, double horizon, double distance_m, double extinction_per_m) {
  return object * bouguer_transmission(extinction_per_m * distance_m) +
         koschmieder_airlight(horizon, distance_m, extinction_per_m);
}

double apparent_contrast(double object, double horizon, double distance_m, double extinction_per_m) {
  return (object - horizon) / horizon * bouguer_transmission(extinction_per_m * distance_m);
}

}  // namespace lampglow::scattering
