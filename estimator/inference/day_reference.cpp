#include "estimator/inference/day_reference.h"

#include "estimator/inference/contrast.h"
#include "estimator/inference/window.h"

namespace lampglow::inference {
namespace {

// Of as many lists of one length as are added.
void add_to_mean(std::vector<double>& mean, const std::vector<double>& values, double number) {
  if (mean.empty()) mean.assign(values.size(), 0.0);
  for (size_t i = 0; i < values.size(); ++i) mean[i] += (values[i] - mean[i]) / number;
}

}  // namespace

void learn_clear_targets(std::span<const photometry::RadianceImage> clear, Site& site) {
  std::vector<double> seen(site.targets.size(), 0.0);
  for (Target& target : site.targets) target.clear.reset();
  for (const photometry::RadianceImage& image : clear) {
    const auto profiles = column_profiles(image, site.targets);
    const DayView view = view_targets(image, site.targets, site.day);
    for (size_t t = 0; t < site.targets.size(); ++t) {
      const std::optional<double> halves = view.targets[t].halves;
      if (profiles[t].sharp.empty() || !halves) continue;  // no sky above the box, or it is saturated
      if (!site.targets[t].clear) site.targets[t].clear.emplace();
      TargetClear& target = *site.targets[t].clear;
      ++seen[t];
      add_to_mean(target.sharp, profiles[t].sharp, seen[t]);
      add_to_mean(target.contrast, profiles[t].contrast, seen[t]);
      target.halves += (*halves - target.halves) / seen[t];
    }
  }
}

}  // namespace lampglow::inference
