// What the clear references by day teach about the targets: how each looks through clear air and a dry
// window.
#pragma once

#include <span>

#include "estimator/photometry/radiance.h"
#include "estimator/site.h"

namespace lampglow::inference {

// Sets Target::clear of the site's targets to the mean of these frames; nothing without any.
void learn_clear_targets(std::span<const photometry::RadianceImage> clear, Site& site);

}  // namespace lampglow::inference
