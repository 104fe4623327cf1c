// A bracket as pictures for people.
#pragma once

#include <memory>
#include <string>

#include "estimator/observation.h"
#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

struct Pictures {
  std::shared_ptr<const std::string> plain_jpeg;      // null without an exposure
  std::shared_ptr<const std::string> annotated_jpeg;  // lamps as circles in the colour of their state
};

// The longest exposure, brightness stretched by asinh so that dark surroundings show.
Pictures render_pictures(const Bracket& bracket, const FrameResult& result, int jpeg_quality);

}  // namespace lampglow::daemon
