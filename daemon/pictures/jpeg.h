// JPEG by libjpeg-turbo.
#pragma once

#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

// Strictly: what is only a warning to the library (data lost or damaged in the middle) is an error here. Grey
// stays grey, CMYK becomes colours, EXIF's orientation is left out. Throws PictureError.
void decode_jpeg(std::span<const std::uint8_t> bytes, RowSink& sink);

// 8 bits, grey or colours, baseline; quality 1..100. Throws PictureError for other shapes.
Bytes encode_jpeg(const PictureView& picture, int quality);

}  // namespace lampglow::daemon
