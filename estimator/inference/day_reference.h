// What the clear references by day teach about the targets: how each looks through clear air and a dry
// window.
#pragma once

#include <vector>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::inference {

// Sets Target::clear of the site's targets to the mean of the frames that are added; nothing without any. The
// site must outlive it.
class ClearTargetLearner {
 public:
  explicit ClearTargetLearner(Site& site);
  void add(const photometry::RadianceImage& image);

 private:
  Site& site_;
  std::vector<double> seen_;  // frames, of each target
};

}  // namespace lampglow::inference
