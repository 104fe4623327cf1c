// A camera through libcamera: exposure, gain and white balance locked, brackets by the controls of each
// request, settings read back from the metadata of the pictures themselves.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

// Exposures carry what the picture's metadata say: exposure_s, and gain_db of the analogue gain (0 dB is a
// gain of 1). A camera whose metadata are silent (libcamera's handler of USB cameras) has the exposure that
// it accepted, and gain_db relative to its locked gain. A camera that would not lock, or whose pictures do
// not follow the exposures, gives frames with camera_not_locked. Throws ConfigError in a build without
// libcamera.
std::unique_ptr<FrameSource> open_libcamera(const SourceOptions& options);

struct LibcameraListing {
  std::string id;   // what stands after `libcamera:`
  SourceInfo info;  // driver, formats and controls
};

// All cameras that libcamera finds now. Throws SourceError, and ConfigError in a build without libcamera.
std::vector<LibcameraListing> list_libcamera();

}  // namespace lampglow::daemon
