// Street lamps burn at full or at reduced power: which of them do, by evidence.
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "estimator/inference/joint_fit.h"

namespace lampglow::inference {

struct Powers {
  double ln_gain = 0, cost = std::numeric_limits<double>::infinity();
  std::vector<double> ln_dimming;
};

// −ln of the probability that just these of the lit lamps are dimmed, with nothing known of how many usually
// are (beta-binomial of ½, ½): all or none are likelier than any one mixture.
double mixture_penalty(const Scene& scene, const std::vector<double>& ln_dimming, std::span<const char> lit);

// The likeliest gain and power of each lamp, given by how much each is brighter than usual (ln; empty: not
// known).
Powers likeliest_powers(const Scene& scene, const std::vector<std::optional<double>>& ln_ratio,
                        const RingData& data, const FitOptions& options);

// By how much each lamp's own rings are brighter than `light`, the model's without any sky; its sky is free.
std::vector<std::optional<double>> ring_ratios(const Scene& scene, const RingData& data,
                                               std::span<const double> light);

}  // namespace lampglow::inference
