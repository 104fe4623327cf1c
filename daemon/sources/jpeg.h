// JPEG by libjpeg-turbo, strictly: a warning of the decoder is an error here.
#pragma once

#include <cstdint>
#include <span>

#include "daemon/sources/image_file.h"

namespace lampglow::daemon {

// Both throw ImageError.
ImageHeader jpeg_header(std::span<const std::uint8_t> bytes);
DecodedImage decode_jpeg(std::span<const std::uint8_t> bytes);

}  // namespace lampglow::daemon
