// Lamps of unknown distance: effective distances from frames whose extinction is known. In each frame the
// joint fit is done with σ held and the distances free; over the frames they are averaged.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/inference/night.h"
#include "estimator/inference/reference.h"

namespace lampglow::inference {

struct LampDistance {
  std::string id;
  double ln_distance = 0, ln_sigma = 0;
};
using DistanceFrame = std::vector<LampDistance>;

// Lamps of the catalogue that are lit and whose distance this frame tells better than the prior. Extinction
// [1/m], > 0.
DistanceFrame fit_distances(const photometry::RadianceImage& image,
                            const photometry::RegisteredFrame& registered, const ClearReference& reference,
                            const HaloModel& halo, double extinction_per_m, const NightOptions& options);

struct LearnedDistance {
  std::optional<double> distance_m;  // empty: the frames can't support it
  double sigma_m = 0;
  int frames = 0;
  double halves_differ = 0;  // |ln| between the odd frames' answer and the even ones': cross-validation
  std::string why_not;
};

LearnedDistance combine_distances(std::span<const DistanceFrame> frames, const std::string& id);

}  // namespace lampglow::inference
