// OpenEXR: pictures of linear brightness, and depth maps.
#pragma once

#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

bool is_exr(std::span<const std::uint8_t> bytes);

// Float samples of the channels R, G, B, else of Y, else of the only channel there is (a depth map's Z).
// Throws PictureError.
void decode_exr(std::span<const std::uint8_t> bytes, RowSink& sink);

// Float, grey (Y) or colours, packed without loss. Throws PictureError for other shapes.
Bytes encode_exr(const PictureView& picture);

}  // namespace lampglow::daemon
