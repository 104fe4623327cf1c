// TIFF by libtiff: the first picture of a file.
#pragma once

#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

// 8, 16 bits or float, grey or colours, in strips or tiles; fewer bits, palettes and other colour spaces
// become 8-bit grey or colours. 64-bit floats become 32. What is said to stand upside down or mirrored is
// turned; what lies on its side is refused. The picture's size and that of its strips and tiles are to be
// checked in the header before. Throws PictureError.
void decode_tiff(std::span<const std::uint8_t> bytes, RowSink& sink);

// 8, 16 bits or float, grey or colours, packed without loss. Throws PictureError for other shapes.
Bytes encode_tiff(const PictureView& picture);

}  // namespace lampglow::daemon
