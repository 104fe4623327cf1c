// PNG by libpng.
#pragma once

#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

// Every kind of PNG: below 8 bits becomes 8, a palette becomes colours, grey with alpha becomes colours with
// alpha. Digital numbers are not scaled otherwise; gamma and colour profiles are left out. The picture's size
// is to be checked in the header, or by sink.begin(). Throws PictureError.
void decode_png(std::span<const std::uint8_t> bytes, RowSink& sink);

// 8 or 16 bits, grey or colours; quick rather than small. Throws PictureError for other shapes.
Bytes encode_png(const PictureView& picture);

}  // namespace lampglow::daemon
