// The validation report's pictures: one scene, clear and in fog.
#pragma once

#include <string>

namespace lampglow::daemon {

// HTML: the clear scene, then mild and dense fog, each with single and with multiple scattering.
std::string rendered_scene();

}  // namespace lampglow::daemon
