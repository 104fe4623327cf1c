#include "daemon/simulation/events.h"

#include <algorithm>
#include <cmath>

#include "daemon/simulation/random.h"

namespace lampglow::simulation {

namespace {

enum Stream : std::uint64_t { kRainTime = 300, kDrops, kShadowTime, kShadows, kSnowTime, kSnow };

constexpr double kPart = 0.4;  // of the frames
constexpr double kSunForShadows_deg = 3;

struct Stretch {
  size_t first = 0, end = 0;  // in Night::frames
};

Stretch stretch_of(const Night& night, Stream stream) {
  Random random(night.options.seed, {stream});
  const double count = night.options.frames;
  const auto first = static_cast<size_t>(night.references + std::floor(random.uniform(0, 1 - kPart) * count));
  return {first, std::min(first + static_cast<size_t>(std::ceil(kPart * count)), night.frames.size())};
}

// From a few drops to a third of the window, some of which have run down.
std::vector<Drop> draw_drops(Random& random) {
  constexpr double kHalfWidth_mm = 0.5 * kWidthPx * kWindowDistance_mm / kFocalLengthPx + 2;
  constexpr double kHalfHeight_mm = 0.5 * kHeightPx * kWindowDistance_mm / kFocalLengthPx + 2;
  const int count = 20 + random.below(200);
  std::vector<Drop> drops;
  for (int i = 0; i < count; ++i) {
    Drop drop;
    drop.x_mm = random.uniform(-kHalfWidth_mm, kHalfWidth_mm);
    drop.y_mm = random.uniform(-kHalfHeight_mm, kHalfHeight_mm);
    drop.radius_mm = std::clamp(0.9 * std::exp(0.4 * random.normal()), 0.3, 2.5);
    drop.rim_slope = random.uniform(0.4, 0.9);
    if (random.chance(0.08)) drop.streak_mm = random.uniform(3, 25);
    drops.push_back(drop);
  }
  return drops;
}

void rain_on_window(Night& night) {
  const Stretch stretch = stretch_of(night, kRainTime);
  for (size_t i = stretch.first; i < stretch.end; ++i) {
    Random random(night.options.seed, {kDrops, i});
    night.frames[i].drops = draw_drops(random);
  }
}

// Broken clouds: the sun shines on one part of a target, up to an edge that wanders over it, and the rest
// lies in shadow. Haze scatters the sun's beam away.
void cast_shadows(Night& night) {
  const Stretch stretch = stretch_of(night, kShadowTime);
  for (size_t i = stretch.first; i < stretch.end; ++i) {
    Frame& frame = night.frames[i];
    if (frame.day.sun.altitude_deg < kSunForShadows_deg) continue;
    Random random(night.options.seed, {kShadows, i});
    const double sunlit = 1 + random.uniform(0.8, 2.5) * std::exp(-400 * frame.extinction_per_m);
    for (size_t t = 0; t < night.targets.size(); ++t)
      frame.day.sunlight.push_back({random.uniform(-0.5, 1.5), sunlit});
  }
}

// On all targets alike but for what trees shake off, and on the ground.
void let_it_snow(Night& night) {
  const Stretch stretch = stretch_of(night, kSnowTime);
  for (size_t i = stretch.first; i < stretch.end; ++i) {
    Frame& frame = night.frames[i];
    Random random(night.options.seed, {kSnow, i});
    const double depth = random.uniform(0.5, 0.8);
    for (size_t t = 0; t <= night.targets.size(); ++t)
      frame.day.snow.push_back(std::min(0.9, depth * std::exp(0.15 * random.normal())));
  }
}

}  // namespace

void add_events(Night& night) {
  if (night.options.events.rain_on_window) rain_on_window(night);
  if (night.options.events.shadows) cast_shadows(night);
  if (night.options.events.snow) let_it_snow(night);
}

}  // namespace lampglow::simulation
