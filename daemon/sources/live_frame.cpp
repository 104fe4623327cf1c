#include "daemon/sources/live_frame.h"

#include <fmt/format.h>

#include "daemon/pictures/image_header.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/image_file.h"

namespace lampglow::daemon {
namespace {

Fault fault_of(QualityFlags quality) {
  if (quality.has(Quality::frame_truncated)) return Fault::torn;
  if (quality.has(Quality::frame_too_large)) return Fault::too_large;
  return Fault::undecodable;
}

}  // namespace

Exposure decode_live_frame(std::span<const std::uint8_t> bytes, const std::string& name,
                           std::size_t max_pixels) {
  if (bytes.empty()) throw SourceError(Fault::torn, name + ": no bytes came");
  const auto header = read_image_header(bytes);
  if (!header) throw SourceError(Fault::not_an_image, name + ": expected a JPEG, PNG or TIFF picture");
  const auto limit = static_cast<std::int64_t>(max_pixels);
  if (header->width_px > 0 && header->height_px > limit / header->width_px) {
    throw SourceError(Fault::too_large, fmt::format("{}: {}x{} pixels, more than the {} allowed", name,
                                                    header->width_px, header->height_px, limit));
  }
  Camera as_it_is;
  as_it_is.width_px = static_cast<int>(header->width_px);
  as_it_is.height_px = static_cast<int>(header->height_px);
  as_it_is.bit_depth = header->bits == 16 ? 16 : 8;
  DecodedImage image = decode_image(bytes, name, as_it_is);
  if (!image.good()) throw SourceError(fault_of(image.quality), image.fault);
  return {name, {}, {}, std::move(image.pixels), image.monochrome};
}

}  // namespace lampglow::daemon
