// One encoded picture from a live camera to an exposure, by the decoder that archives use too.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

// JPEG, PNG or TIFF of any size up to max_pixels, 8 or 16 bits. Throws SourceError with not_an_image, torn,
// undecodable or too_large. exposure_s and gain_db stay empty.
Exposure decode_live_frame(std::span<const std::uint8_t> bytes, const std::string& name,
                           std::size_t max_pixels);

}  // namespace lampglow::daemon
