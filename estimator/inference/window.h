// Water on the window. Fog takes the same part of the contrast from every strip of a target, for all of it is
// equally far. A drop before the lens lays its own blurred picture of the scene over a part of the target
// alone: there the sharp contrast is weaker than in the rest of it, against the clear reference, and so is
// the contrast of the dark body to the sky above it. Light does not do both: what the sun brightens shows
// more texture, what lies in shadow is darker.
//
// Fog is uneven, and a strip behind thicker air is weaker in both, too: by e^(−ε·τ) where its extinction is ε
// above the rest's. A strip must be weaker than that to count.
//
// What was tried and does not tell drops from fair weather: fine over coarse edge energy. A drop is so far
// out of focus that it weakens both alike, and on the real day at De Bilt the sun changes the ratio by e and
// more.
#pragma once

#include <optional>
#include <vector>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::inference {

struct WindowOptions {
  int strip_px = 12;
  int farthest_shift_px = 6;     // of the camera in the wind, sideways
  double least_contrast = 0.33;  // of a target's body to the sky in the reference: else it is no skyline
  double least_seen = 0.15;      // of the reference's sharp contrast: thicker fog lets nothing be told
  double most_noise = 0.1;       // of the sharp contrast's energy
  double weaker = 0.85;          // than the target's clearest strips, in both: this strip is behind water
  double clearest = 0.75;        // quantile
  double uneven_air = 0.15;      // ε, between strips of one target
  int least_strips = 8;          // in all targets together
  double least_part = 0.12;      // of them: flagged
};

// What the columns of a target's box look like, `kMarginPx` more on both sides.
struct ColumnProfile {
  std::vector<double> sharp;  // mean squared difference over 4 px of the picture averaged over 3x3 px, over
                              // the brightness of the sky above squared; noise taken off
  std::vector<double> noise;  // what noise had put into it
  std::vector<double> contrast;  // 1 − body over sky
};

inline constexpr int kMarginPx = 8;

// Of every target; empty for a target with no sky above its box in the picture.
std::vector<ColumnProfile> column_profiles(const photometry::RadianceImage& image,
                                           const std::vector<Target>& targets);

// A target's strips that could be judged, and those of them behind water.
struct TargetWindow {
  int strips = 0, weaker = 0;
};
std::vector<TargetWindow> view_window(const std::vector<ColumnProfile>& now,
                                      const std::vector<Target>& targets, const WindowOptions& options = {});

// Enough of both, in all targets together, to speak of rain?
bool rain_on_window(const std::vector<TargetWindow>& window, const WindowOptions& options = {});

}  // namespace lampglow::inference
