// JPEG by libjpeg-turbo, strictly: what is only a warning to the decoder (data lost or damaged in the middle)
// is an error here. OpenCV decodes the same bytes to the same values, but only prints the warning.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace lampglow::daemon {

struct JpegPicture {
  int width_px = 0;
  int height_px = 0;
  int channels = 1;                   // 1, or 3 as blue, green, red
  std::vector<std::uint8_t> samples;  // row by row
  std::string damage;                 // the decoder's complaint; empty if all is well
};

// A picture that is not of this size is damaged, and nothing is decoded: its header was read before.
JpegPicture decode_jpeg(std::span<const std::uint8_t> bytes, int width_px, int height_px);

}  // namespace lampglow::daemon
