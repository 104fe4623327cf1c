#include "daemon/sources/raw_frame.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "daemon/sources/fault.h"
#include "daemon/sources/live_frame.h"

namespace lampglow::daemon {
namespace {

using enum RawKind;
using Picture = Image<std::uint16_t>;

constexpr std::array kFormats{
    RawFormat{"Y16 ", grey16, 16},
    RawFormat{"Y16\xA0", grey16_big_endian, 16},  // 'Y16 ' with the big-endian bit
    RawFormat{"Y14 ", grey16, 14},
    RawFormat{"Y12 ", grey16, 12},
    RawFormat{"Y12P", packed12, 12},
    RawFormat{"Y10 ", grey16, 10},
    RawFormat{"Y10P", packed10, 10},
    RawFormat{"RG16", grey16, 16, true},
    RawFormat{"BYR2", grey16, 16, true},
    RawFormat{"GR16", grey16, 16, true, true},
    RawFormat{"GB16", grey16, 16, true, true},
    RawFormat{"RG12", grey16, 12, true},
    RawFormat{"BG12", grey16, 12, true},
    RawFormat{"BA12", grey16, 12, true, true},  // GRBG
    RawFormat{"GB12", grey16, 12, true, true},
    RawFormat{"pRCC", packed12, 12, true},
    RawFormat{"pBCC", packed12, 12, true},
    RawFormat{"pgCC", packed12, 12, true, true},
    RawFormat{"pGCC", packed12, 12, true, true},
    RawFormat{"RG10", grey16, 10, true},
    RawFormat{"BG10", grey16, 10, true},
    RawFormat{"BA10", grey16, 10, true, true},  // GRBG
    RawFormat{"GB10", grey16, 10, true, true},
    RawFormat{"pRAA", packed10, 10, true},
    RawFormat{"pBAA", packed10, 10, true},
    RawFormat{"pgAA", packed10, 10, true, true},
    RawFormat{"pGAA", packed10, 10, true, true},
    RawFormat{"GREY", grey8, 8},
    RawFormat{"RGGB", grey8, 8, true},
    RawFormat{"BA81", grey8, 8, true},  // BGGR
    RawFormat{"GRBG", grey8, 8, true, true},
    RawFormat{"GBRG", grey8, 8, true, true},
    RawFormat{"YUYV", yuyv, 8},
    RawFormat{"UYVY", uyvy, 8},
    RawFormat{"NV12", nv12, 8},
    RawFormat{"MJPG", jpeg, 8},
    RawFormat{"JPEG", jpeg, 8},
};

struct LibcameraName {
  std::string_view name, fourcc;
};

constexpr std::array kLibcameraNames{
    LibcameraName{"R8", "GREY"},
    LibcameraName{"R10", "Y10 "},
    LibcameraName{"R12", "Y12 "},
    LibcameraName{"R16", "Y16 "},
    LibcameraName{"R10_CSI2P", "Y10P"},
    LibcameraName{"R12_CSI2P", "Y12P"},
    LibcameraName{"SRGGB8", "RGGB"},
    LibcameraName{"SBGGR8", "BA81"},
    LibcameraName{"SGRBG8", "GRBG"},
    LibcameraName{"SGBRG8", "GBRG"},
    LibcameraName{"SRGGB10", "RG10"},
    LibcameraName{"SBGGR10", "BG10"},
    LibcameraName{"SGRBG10", "BA10"},
    LibcameraName{"SGBRG10", "GB10"},
    LibcameraName{"SRGGB12", "RG12"},
    LibcameraName{"SBGGR12", "BG12"},
    LibcameraName{"SGRBG12", "BA12"},
    LibcameraName{"SGBRG12", "GB12"},
    LibcameraName{"SRGGB16", "RG16"},
    LibcameraName{"SBGGR16", "BYR2"},
    LibcameraName{"SGRBG16", "GR16"},
    LibcameraName{"SGBRG16", "GB16"},
    LibcameraName{"SRGGB10_CSI2P", "pRAA"},
    LibcameraName{"SBGGR10_CSI2P", "pBAA"},
    LibcameraName{"SGRBG10_CSI2P", "pgAA"},
    LibcameraName{"SGBRG10_CSI2P", "pGAA"},
    LibcameraName{"SRGGB12_CSI2P", "pRCC"},
    LibcameraName{"SBGGR12_CSI2P", "pBCC"},
    LibcameraName{"SGRBG12_CSI2P", "pgCC"},
    LibcameraName{"SGBRG12_CSI2P", "pGCC"},
    LibcameraName{"YUYV", "YUYV"},
    LibcameraName{"UYVY", "UYVY"},
    LibcameraName{"NV12", "NV12"},
    LibcameraName{"MJPEG", "MJPG"},
};

std::size_t line_bytes(RawKind kind, int width_px) {
  const auto width = static_cast<std::size_t>(width_px);
  switch (kind) {
    case packed10:
      return (width * 10 + 7) / 8;
    case packed12:
      return (width * 12 + 7) / 8;
    case grey8:
    case nv12:
      return width;
    default:
      return 2 * width;
  }
}

const std::uint8_t* line(const RawFrame& frame, int row) {
  return frame.bytes.data() + static_cast<std::size_t>(row) * frame.stride_bytes;
}

// MIPI CSI-2 packing: groups of samples' high bytes, then one byte with their low bits (four samples of 10
// bits, or two of 12).
std::uint16_t packed_sample(const std::uint8_t* in, int column, int bits) {
  const int group = bits == 10 ? 4 : 2, low_bits = bits - 8;
  const int place = column % group;
  const std::uint8_t* at = in + static_cast<std::ptrdiff_t>(column / group) * (group + 1);
  const int low = at[group] >> (place * low_bits) & ((1 << low_bits) - 1);
  return static_cast<std::uint16_t>(at[place] << low_bits | low);
}

Picture samples(const RawFrame& frame) {
  Picture picture(frame.width_px, frame.height_px);
  for (int row = 0; row < frame.height_px; ++row) {
    const std::uint8_t* in = line(frame, row);
    std::uint16_t* out = &picture.at(0, row);
    for (std::ptrdiff_t i = 0; i < frame.width_px; ++i) {
      switch (frame.format->kind) {
        case grey8:
          out[i] = in[i];
          break;
        case grey16:
          out[i] = static_cast<std::uint16_t>(in[2 * i] | in[2 * i + 1] << 8);
          break;
        case grey16_big_endian:
          out[i] = static_cast<std::uint16_t>(in[2 * i] << 8 | in[2 * i + 1]);
          break;
        default:
          out[i] = packed_sample(in, static_cast<int>(i), frame.format->bits);
      }
    }
  }
  return picture;
}

// Green where the mosaic has none: the mean of the neighbours above, below, left and right (all are green).
void interpolate_green(Picture& picture, bool green_at_even) {
  for (int row = 0; row < picture.height_px; ++row) {
    for (int column = (row + (green_at_even ? 1 : 0)) % 2; column < picture.width_px; column += 2) {
      int sum = 0, count = 0;
      for (const auto& [x, y] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}}) {
        if (!picture.contains(column + x, row + y)) continue;
        sum += picture.at(column + x, row + y);
        ++count;
      }
      picture.at(column, row) = static_cast<std::uint16_t>(count == 0 ? 0 : (sum + count / 2) / count);
    }
  }
}

// Green from luma and chroma (ITU-R BT.601 / BT.709, with the coding's weights).
class GreenOf {
 public:
  explicit GreenOf(const YuvCoding& coding)
      : black_(coding.full_range ? 0 : 16), luma_gain_(coding.full_range ? 1 : 255.0 / 219) {
    const double green_weight = 1 - coding.red_weight - coding.blue_weight;
    const double chroma_gain = coding.full_range ? 1 : 255.0 / 224;
    from_cr_ = chroma_gain * 2 * (1 - coding.red_weight) * coding.red_weight / green_weight;
    from_cb_ = chroma_gain * 2 * (1 - coding.blue_weight) * coding.blue_weight / green_weight;
  }
  std::uint16_t operator()(int luma, int cb, int cr) const {
    const double green = luma_gain_ * (luma - black_) - from_cb_ * (cb - 128) - from_cr_ * (cr - 128);
    return static_cast<std::uint16_t>(std::clamp(std::lround(green), 0L, 255L));
  }

 private:
  double black_, luma_gain_, from_cr_ = 0, from_cb_ = 0;
};

struct Chroma {
  int cb, cr;
};

Chroma chroma_at(const RawFrame& frame, int column, int row) {
  const std::ptrdiff_t pair = column / 2;
  if (frame.format->kind == nv12) {
    const std::uint8_t* in = line(frame, frame.height_px + row / 2) + 2 * pair;
    return {in[0], in[1]};
  }
  const std::uint8_t* in = line(frame, row) + 4 * pair;
  return frame.format->kind == yuyv ? Chroma{in[1], in[3]} : Chroma{in[0], in[2]};
}

int luma_at(const RawFrame& frame, int column, int row) {
  const std::uint8_t* in = line(frame, row);
  const std::ptrdiff_t place = column;
  if (frame.format->kind == nv12) return in[place];
  return frame.format->kind == yuyv ? in[2 * place] : in[2 * place + 1];
}

void decode_yuv(const RawFrame& frame, Exposure& exposure) {
  const GreenOf green(frame.coding);
  exposure.pixels = Picture(frame.width_px, frame.height_px);
  std::size_t coloured = 0;  // a codec's rounding is no colour, nor is a thousandth of the pixels
  for (int row = 0; row < frame.height_px; ++row) {
    for (int column = 0; column < frame.width_px; ++column) {
      const auto [cb, cr] = chroma_at(frame, column, row);
      coloured += std::abs(cb - 128) > 2 || std::abs(cr - 128) > 2;
      exposure.pixels.at(column, row) = green(luma_at(frame, column, row), cb, cr);
    }
  }
  exposure.monochrome = coloured * 1000 <= exposure.pixels.pixels.size();
}

void require_bytes(const RawFrame& frame, const std::string& name) {
  const auto height = static_cast<std::size_t>(frame.height_px);
  const std::size_t rows = frame.format->kind == nv12 ? height + (height + 1) / 2 : height;
  const std::size_t last = line_bytes(frame.format->kind, frame.width_px);
  const std::size_t needed = rows == 0 ? 0 : (rows - 1) * frame.stride_bytes + last;
  if (frame.stride_bytes < last || frame.bytes.size() < needed) {
    throw SourceError(Fault::torn,
                      fmt::format("{}: the frame has {} bytes of {}", name, frame.bytes.size(), needed));
  }
}

}  // namespace

std::span<const RawFormat> raw_formats() {
  return kFormats;
}

const RawFormat* find_raw_format(std::string_view fourcc) {
  const auto* found = std::ranges::find(kFormats, fourcc, &RawFormat::fourcc);
  return found == kFormats.end() ? nullptr : found;
}

const RawFormat* find_libcamera_format(std::string_view name) {
  const auto* found = std::ranges::find(kLibcameraNames, name, &LibcameraName::name);
  return found == kLibcameraNames.end() ? nullptr : find_raw_format(found->fourcc);
}

Exposure decode_raw_frame(const RawFrame& frame, const std::string& name, std::size_t max_pixels) {
  if (frame.format->kind == jpeg) return decode_live_frame(frame.bytes, name, max_pixels);
  if (static_cast<std::size_t>(frame.width_px) * static_cast<std::size_t>(frame.height_px) > max_pixels) {
    throw SourceError(Fault::too_large,
                      fmt::format("{}: {}x{} pixels", name, frame.width_px, frame.height_px));
  }
  require_bytes(frame, name);
  Exposure exposure{name, {}, {}, {}, !frame.format->bayer};
  const RawKind kind = frame.format->kind;
  if (kind == yuyv || kind == uyvy || kind == nv12) {
    decode_yuv(frame, exposure);
  } else {
    exposure.pixels = samples(frame);
    if (frame.format->bayer) interpolate_green(exposure.pixels, frame.format->green_at_even);
  }
  return exposure;
}

}  // namespace lampglow::daemon
