// What a picture file says about itself, read without decoding any pixel: so a picture of a wrong size, a
// cut-off one and a decompression bomb are known before a decoder sees them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace lampglow::daemon {

enum class ImageFormat { png, jpeg, tiff };

struct ImageHeader {
  ImageFormat format = ImageFormat::png;
  std::int64_t width_px = 0;
  std::int64_t height_px = 0;
  int bits = 0;           // of one sample
  int channels = 0;       // samples of one pixel
  bool complete = false;  // the file reaches its end as its own structure tells
};

// Empty if the bytes are no PNG, JPEG (baseline, extended or progressive Huffman) or TIFF whose header can be
// read.
std::optional<ImageHeader> read_image_header(std::span<const std::uint8_t> bytes);

}  // namespace lampglow::daemon
