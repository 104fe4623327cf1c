// A homogeneous medium. Lengths in metres, coefficients per metre; "optical" lengths are lengths times the
// extinction coefficient.
#pragma once

namespace lampglow::scattering {

// How the air takes light out of a beam. extinction = scattering + absorption; albedo = scattering /
// extinction.
struct Medium {
  double extinction_per_m = 0;  // σ, > 0
  double albedo = 1;            // ω0, 0..1
  double q = 0;                 // Henyey-Greenstein asymmetry, -1 < q < 1

  double scattering_per_m() const { return albedo * extinction_per_m; }
  double absorption_per_m() const { return (1 - albedo) * extinction_per_m; }
  // σ(1 - ω0 q): what the extinction of an isotropically scattering medium of the same diffusion would be.
  double transport_per_m() const { return extinction_per_m * (1 - albedo * q); }
};

// Throws std::invalid_argument, naming field, value and constraint, if the medium cannot be.
void check(const Medium& medium);

// T = σR.
double optical_thickness(double extinction_per_m, double distance_m);

// Visibility for a contrast threshold of 2 % (3.912/σ, Middleton 1952, the lecture's) and of 5 %
// (MOR, 2.996/σ, WMO-No. 8). extinction > 0.
double visibility_two_percent_m(double extinction_per_m);
double meteorological_optical_range_m(double extinction_per_m);
double extinction_from_mor_per_m(double mor_m);

}  // namespace lampglow::scattering
