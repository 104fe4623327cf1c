#include "daemon/sources/jpeg.h"

#include <fmt/format.h>

#include <cstdio>
#include <vector>
// jpeglib.h needs size_t and FILE before it.
#include <jerror.h>
#include <jpeglib.h>

namespace lampglow::daemon {
namespace {

using Bytes = std::span<const std::uint8_t>;

std::string message_of(j_common_ptr info) {
  char text[JMSG_LENGTH_MAX];
  info->err->format_message(info, text);
  return text;
}

// libjpeg is built with unwind tables, so an exception may pass through it (as the manual's longjmp would).
[[noreturn]] void fail(j_common_ptr info) {
  throw ImageError(Quality::frame_undecodable, "JPEG can't be decoded: " + message_of(info));
}

void complain(j_common_ptr info, int level) {
  if (level >= 0) return;  // traces
  // Bytes before a marker are padding that some cameras write; every other warning means lost data.
  if (info->err->msg_code == JWRN_EXTRANEOUS_DATA && info->err->msg_parm.i[1] == 0xD9) return;
  throw ImageError(Quality::frame_truncated, "JPEG is torn: " + message_of(info));
}

class Decompressor {
 public:
  explicit Decompressor(Bytes bytes) {
    info_.err = jpeg_std_error(&errors_);
    errors_.error_exit = fail;
    errors_.emit_message = complain;
    jpeg_create_decompress(&info_);
    try {
      jpeg_mem_src(&info_, bytes.data(), bytes.size());
      jpeg_read_header(&info_, TRUE);
    } catch (...) {
      jpeg_destroy_decompress(&info_);
      throw;
    }
  }
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;
  ~Decompressor() { jpeg_destroy_decompress(&info_); }

  ImageHeader header() const {
    return {"JPEG", static_cast<int>(info_.image_width), static_cast<int>(info_.image_height), 8,
            info_.num_components};
  }

  DecodedImage decode() {
    if (info_.num_components != 1 && info_.num_components != 3) {
      throw ImageError(Quality::frame_undecodable, fmt::format("JPEG of {} channels", info_.num_components));
    }
    info_.out_color_space = info_.num_components == 1 ? JCS_GRAYSCALE : JCS_RGB;
    info_.dct_method = JDCT_ISLOW;
    jpeg_start_decompress(&info_);
    DecodedImage image{header(), Image<std::uint16_t>(header().width_px, header().height_px), true};
    std::vector<JSAMPLE> line(static_cast<std::size_t>(image.pixels.width_px) * static_cast<std::size_t>(info_.num_components));
    while (info_.output_scanline < info_.output_height) {
      const int row = static_cast<int>(info_.output_scanline);
      JSAMPROW pointer = line.data();
      jpeg_read_scanlines(&info_, &pointer, 1);
      take_line(line, row, image);
    }
    jpeg_finish_decompress(&info_);
    return image;
  }

 private:
  void take_line(const std::vector<JSAMPLE>& line, int row, DecodedImage& image) const {
    const JSAMPLE* in = line.data();
    std::uint16_t* out = &image.pixels.at(0, row);
    if (info_.num_components == 1) {
      for (int column = 0; column < image.pixels.width_px; ++column) out[column] = in[column];
      return;
    }
    int differs = 0;
    for (int column = 0; column < image.pixels.width_px; ++column, in += 3) {
      out[column] = in[1];
      differs |= (in[0] ^ in[1]) | (in[1] ^ in[2]);
    }
    if (differs != 0) image.monochrome = false;
  }

  jpeg_decompress_struct info_{};
  jpeg_error_mgr errors_{};
};

// The end marker must be there; cameras pad with zeros or a few bytes after it.
void require_end(Bytes bytes) {
  for (std::size_t i = bytes.size(); i >= 2; --i) {
    if (bytes[i - 2] == 0xFF && bytes[i - 1] == 0xD9) return;
    if (bytes.size() - i > 4096) break;
  }
  throw ImageError(Quality::frame_truncated, "JPEG has no end marker: it is cut off");
}

}  // namespace

ImageHeader jpeg_header(Bytes bytes) { return Decompressor(bytes).header(); }

DecodedImage decode_jpeg(Bytes bytes) {
  require_end(bytes);
  return Decompressor(bytes).decode();
}

}  // namespace lampglow::daemon
