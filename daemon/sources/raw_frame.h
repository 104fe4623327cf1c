// Raw frames as devices give them, to digital numbers. Pure functions of bytes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

enum class RawKind { grey8, grey16, grey16_big_endian, packed10, packed12, yuyv, uyvy, nv12, jpeg };

// One pixel format of the V4L2 list (linux/videodev2.h) that we can read.
struct RawFormat {
  std::string_view fourcc;  // "GREY"; four characters
  RawKind kind;
  int bits;                    // of a sample
  bool bayer = false;          // one colour per pixel: green is kept, and interpolated between
  bool green_at_even = false;  // bayer: green where row + column is even (GRBG, GBRG)
};

// Best for photometry first: many bits and one value per pixel before colour, compressed last.
std::span<const RawFormat> raw_formats();
const RawFormat* find_raw_format(std::string_view fourcc);  // nullptr: can't be read
// By libcamera's name of it, "SRGGB12_CSI2P" (libcamera/formats.h).
const RawFormat* find_libcamera_format(std::string_view name);

// How luma and chroma make green: weights of red and blue in luma, and whether black is 16 and white 235.
struct YuvCoding {
  double red_weight = 0.299;  // ITU-R BT.601
  double blue_weight = 0.114;
  bool full_range = false;
};

struct RawFrame {
  const RawFormat* format = nullptr;
  int width_px = 0;
  int height_px = 0;
  std::size_t stride_bytes = 0;
  YuvCoding coding;
  std::span<const std::uint8_t> bytes;
};

// Mono, or green. YUV is rounded to 0..255. Throws SourceError(torn) where bytes are missing; for jpeg, what
// decode_live_frame throws. exposure_s and gain_db stay empty.
Exposure decode_raw_frame(const RawFrame& frame, const std::string& name, std::size_t max_pixels);

}  // namespace lampglow::daemon
