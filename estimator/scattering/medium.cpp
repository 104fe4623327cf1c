#include "estimator/scattering/medium.h"

namespace lampglow::scattering {

double optical_thickness(double extinction_per_m, double distance_m) {
  return extinction_per_m * distance_m;
}

}  // namespace lampglow::scattering
