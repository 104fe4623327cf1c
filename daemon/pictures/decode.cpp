#include "daemon/pictures/decode.h"

#include "daemon/pictures/jpeg.h"
#include "daemon/pictures/png.h"
#include "daemon/pictures/tiff.h"

namespace lampglow::daemon {

void decode_picture(ImageFormat format, std::span<const std::uint8_t> bytes, RowSink& sink) {
  switch (format) {
    case ImageFormat::png:
      return decode_png(bytes, sink);
    case ImageFormat::jpeg:
      return decode_jpeg(bytes, sink);
    case ImageFormat::tiff:
      return decode_tiff(bytes, sink);
  }
}

}  // namespace lampglow::daemon
