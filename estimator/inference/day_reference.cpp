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

ClearTargetLearner::ClearTargetLearner(Site& site) : site_(site), seen_(site.targets.size(), 0.0) {
  for (Target& target : site.targets) target.clear.reset();
}

void ClearTargetLearner::add(const photometry::RadianceImage& image) {
  const auto profiles = column_profiles(image, site_.targets);
  const DayView view = view_targets(image, site_.targets, site_.day);
  for (size_t t = 0; t < site_.targets.size(); ++t) {
    const std::optional<double> halves = view.targets[t].halves;
    if (profiles[t].sharp.empty() || !halves) continue;  // no sky above the box, or it is saturated
    if (!site_.targets[t].clear) site_.targets[t].clear.emplace();
    TargetClear& target = *site_.targets[t].clear;
    ++seen_[t];
    add_to_mean(target.sharp, profiles[t].sharp, seen_[t]);
    add_to_mean(target.contrast, profiles[t].contrast, seen_[t]);
    target.halves += (*halves - target.halves) / seen_[t];
  }
}

}  // namespace lampglow::inference
