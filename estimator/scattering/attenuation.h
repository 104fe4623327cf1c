// The 0th and 1st order of the lecture: what is left of a beam, and the airlight that veils a distant object.
#pragma once

namespace lampglow::scattering {

// Bouguer 1729, Essai d'optique: transmission e^(-T) along an optical thickness T >= 0.
double bouguer_transmission(double thickness);

// Irradiance E = I e^(-T)/R² [W/m²] from a lamp of intensity I [W/sr] at R > 0 metres.
double bouguer_irradiance(double intensity, double distance_m, double extinction_per_m);

// Koschmieder 1924, Theorie der horizontalen Sichtweite: airlight E∞ (1 - e^(-σd)), in the units of the
// horizon sky's brightness E∞.
double koschmieder_airlight(double horizon, double distance_m, double extinction_per_m);

// Both combined: E(d) = E0 e^(-σd) + E∞ (1 - e^(-σd)), E0 the object's own brightness.
double attenuation_with_airlight(double object, double horizon, double distance_m, double extinction_per_m);

// The object's apparent contrast to the horizon sky, (E - E∞)/E∞ = C0 e^(-σd).
double apparent_contrast(double object, double horizon, double distance_m, double extinction_per_m);

}  // namespace lampglow::scattering
