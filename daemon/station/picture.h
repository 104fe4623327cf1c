// A bracket as pictures for people.
#pragma once

#include <memory>
#include <string>

#include "estimator/observation.h"
#include "estimator/photometry/exposure.h"
#include "estimator/site.h"

namespace lampglow::daemon {

struct Pictures {
  std::shared_ptr<const std::string> plain_jpeg;      // null without an exposure
  std::shared_ptr<const std::string> annotated_jpeg;  // with lamps, their states, and targets
};

// The exposure that shows most, in full size, stretched for the eye (daemon/annotate.h).
Pictures render_pictures(const Bracket& bracket, const Site& site, const FrameResult& result,
                         int jpeg_quality);

}  // namespace lampglow::daemon
