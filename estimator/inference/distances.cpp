#include "estimator/inference/distances.h"

#include <algorithm>
#include <cmath>

#include "estimator/observation.h"

namespace lampglow::inference {
namespace {

constexpr double kUseful = 0.5;  // of the prior's width: else the frame says nothing of this lamp
constexpr int kLeastFrames = 4;
constexpr double kWorstSigma = 0.35;  // of ln distance, to be written down
constexpr double kWorstHalves = 0.5;

struct Mean {
  double ln_distance = 0, ln_sigma = 0;
};

// Inverse-variance mean after dropping what is far from the median; σ from the scatter if that is larger.
Mean robust_mean(std::vector<LampDistance> all) {
  std::sort(all.begin(), all.end(),
            [](const LampDistance& a, const LampDistance& b) { return a.ln_distance < b.ln_distance; });
  const double median = all[all.size() / 2].ln_distance;
  double sum = 0, weight = 0, square = 0;
  int count = 0;
  for (const LampDistance& one : all) {
    const double width = std::hypot(one.ln_sigma, 0.1);
    if (std::abs(one.ln_distance - median) > 3 * width) continue;
    const double w = 1 / (width * width);
    sum += w * one.ln_distance;
    weight += w;
    square += w * (one.ln_distance - median) * (one.ln_distance - median);
    ++count;
  }
  if (count == 0) return {median, 1.0};
  const double scatter = std::sqrt(square / weight / count);
  return {sum / weight, std::max(std::sqrt(1 / weight), scatter)};
}

}  // namespace

DistanceFrame fit_distances(const photometry::RadianceImage& image,
                            const photometry::RegisteredFrame& registered, const ClearReference& reference,
                            const HaloModel& halo, double extinction_per_m, const NightOptions& options) {
  const Scene& scene = *reference.scene;
  RingData data = ring_data(image, registered, *reference.rings, registered.strays, options.errors);
  for (size_t j = 0; j < data.lit.size(); ++j) {
    const LampState state = registered.lamps[j].state;
    data.lit[j] = state == LampState::seen || state == LampState::saturated || state == LampState::faded;
  }
  FitOptions fit_options = options.fit;
  fit_options.gain_known = !image.relative && !reference.relative;
  fit_options.posterior = false;
  const double mor_m = kMorTimesExtinction / extinction_per_m;
  fit_options.min_mor_m = mor_m * 0.999;
  fit_options.max_mor_m = mor_m * 1.001;
  const JointFit fit = fit_jointly(scene, halo, data, fit_options);
  const Layout at(scene.lamps().size());
  DistanceFrame distances;
  for (size_t j = 0; j < scene.lamps().size(); ++j) {
    const SceneLamp& lamp = scene.lamps()[j];
    const double sigma = fit.sigma[at.ln_distance(j)];
    if (!lamp.catalogued || !data.lit[j] || sigma <= 0 || sigma > kUseful * lamp.distance_ln_sigma) continue;
    distances.push_back(
        {lamp.id, std::log(lamp.distance_m.value_or(1.0)) + fit.parameters[at.ln_distance(j)], sigma});
  }
  return distances;
}

LearnedDistance combine_distances(std::span<const DistanceFrame> frames, const std::string& id) {
  std::vector<LampDistance> all, odd, even;
  for (const DistanceFrame& frame : frames)
    for (const LampDistance& one : frame)
      if (one.id == id) {
        all.push_back(one);
        (all.size() % 2 ? odd : even).push_back(one);
      }
  LearnedDistance learned;
  learned.frames = static_cast<int>(all.size());
  if (learned.frames < kLeastFrames) {
    learned.why_not = "only " + std::to_string(learned.frames) +
                      " frames say anything of its distance; at least " + std::to_string(kLeastFrames) +
                      " are needed";
    return learned;
  }
  const Mean mean = robust_mean(all);
  learned.halves_differ = std::abs(robust_mean(odd).ln_distance - robust_mean(even).ln_distance);
  if (mean.ln_sigma > kWorstSigma || learned.halves_differ > kWorstHalves) {
    learned.why_not = "the frames disagree about its distance";
    return learned;
  }
  learned.distance_m = std::exp(mean.ln_distance);
  learned.sigma_m = *learned.distance_m * std::max(mean.ln_sigma, learned.halves_differ / 2);
  return learned;
}

}  // namespace lampglow::inference
