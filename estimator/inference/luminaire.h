// How much a luminaire's halo is stronger than an even lamp's of the same beam, in air of any q. The light
// that reaches the camera by the air left the lamp at some angle from the beam, the wider the lower q is; a
// lamp that sends its light down is brighter there. Photons of a disc that faces down, seen 3.5° below its
// plane, against an even lamp's (daemon/simulation/cutoff.h, T = 1, mean over 0.3° to 1°): ln ratio 0.65,
// 0.49, 0.41, 0.32, 0.22, 0.14, 0.04 for q = 0.75, 0.80, 0.84, 0.87, 0.90, 0.93, 0.955; seen 1.3° below,
// three times that. It goes as 1 − q.
#pragma once

namespace lampglow::inference {

inline constexpr double kLuminaireQ = 0.87;  // fog's: where SceneLamp::ln_halo is what it says

inline double luminaire_weight(double q) {
  return (1 - q) / (1 - kLuminaireQ);
}
inline constexpr double kLuminaireWeightSlope = -1 / (1 - kLuminaireQ);

}  // namespace lampglow::inference
