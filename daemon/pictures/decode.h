// Any picture whose format its header told.
#pragma once

#include "daemon/pictures/image_header.h"
#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

// Throws PictureError, and what the sink throws.
void decode_picture(ImageFormat format, std::span<const std::uint8_t> bytes, RowSink& sink);

}  // namespace lampglow::daemon
