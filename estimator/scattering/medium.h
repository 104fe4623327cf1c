// A homogeneous medium, and what a length of it does to light.
#pragma once

namespace lampglow::scattering {

// T = σR.
double optical_thickness(double extinction_per_m, double distance_m);

}  // namespace lampglow::scattering
