#include "daemon/pictures/jpeg.h"

#include <cstdio>
#include <cstdlib>
// jpeglib.h needs size_t and FILE before it.
#include <jerror.h>
#include <jpeglib.h>

namespace lampglow::daemon {
namespace {

// libjpeg is built with unwind tables, so an exception may pass through it (as the manual's longjmp would).
[[noreturn]] void fail(j_common_ptr info) {
  char text[JMSG_LENGTH_MAX];
  info->err->format_message(info, text);
  throw PictureError(text);
}

void complain(j_common_ptr info, int level) {
  if (level >= 0) return;  // traces
  // Bytes before the end marker are padding that some cameras write; every other warning means lost data.
  if (info->err->msg_code == JWRN_EXTRANEOUS_DATA && info->err->msg_parm.i[1] == 0xD9) return;
  fail(info);
}

// Inks as Adobe writes them, 255 for none: each darkens what black leaves.
void cmyk_to_rgb(std::vector<std::uint8_t>& row, int width_px) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(width_px); ++i) {
    const int black = row[4 * i + 3];
    for (std::size_t ink = 0; ink < 3; ++ink)
      row[3 * i + ink] = static_cast<std::uint8_t>(black - ((255 - row[4 * i + ink]) * black >> 8));
  }
}

class Decompressor {
 public:
  Decompressor() {
    info_.err = jpeg_std_error(&errors_);
    errors_.error_exit = fail;
    errors_.emit_message = complain;
    jpeg_create_decompress(&info_);
  }
  Decompressor(const Decompressor&) = delete;
  Decompressor& operator=(const Decompressor&) = delete;
  ~Decompressor() { jpeg_destroy_decompress(&info_); }

  void decode(std::span<const std::uint8_t> bytes, RowSink& sink) {
    jpeg_mem_src(&info_, bytes.data(), bytes.size());
    jpeg_read_header(&info_, TRUE);
    const int components = info_.num_components;
    if (components != 1 && components != 3 && components != 4) throw PictureError("neither mono nor colour");
    const PictureShape shape{static_cast<int>(info_.image_width), static_cast<int>(info_.image_height),
                             components == 1 ? 1 : 3, 8};
    sink.begin(shape);
    info_.out_color_space = components == 1 ? JCS_GRAYSCALE : components == 3 ? JCS_RGB : JCS_CMYK;
    info_.dct_method = JDCT_ISLOW;
    jpeg_start_decompress(&info_);
    const auto width = static_cast<std::size_t>(shape.width_px);
    std::vector<std::uint8_t> samples(width * static_cast<std::size_t>(components));
    for (int row = 0; row < shape.height_px; ++row) {
      JSAMPROW line = samples.data();
      jpeg_read_scanlines(&info_, &line, 1);
      if (components == 4) cmyk_to_rgb(samples, shape.width_px);
      sink.take(row, std::span<const std::uint8_t>(samples).first(width *
                                                                  static_cast<std::size_t>(shape.channels)));
    }
    jpeg_finish_decompress(&info_);
  }

 private:
  jpeg_decompress_struct info_{};
  jpeg_error_mgr errors_{};
};

class Compressor {
 public:
  Compressor() {
    info_.err = jpeg_std_error(&errors_);
    errors_.error_exit = fail;
    errors_.emit_message = complain;
    jpeg_create_compress(&info_);
  }
  Compressor(const Compressor&) = delete;
  Compressor& operator=(const Compressor&) = delete;
  ~Compressor() {
    jpeg_destroy_compress(&info_);
    std::free(bytes_);
  }

  Bytes encode(const PictureShape& shape, std::span<const std::uint8_t> samples, int quality) {
    jpeg_mem_dest(&info_, &bytes_, &size_);
    info_.image_width = static_cast<JDIMENSION>(shape.width_px);
    info_.image_height = static_cast<JDIMENSION>(shape.height_px);
    info_.input_components = shape.channels;
    info_.in_color_space = shape.channels == 1 ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_set_defaults(&info_);
    jpeg_set_quality(&info_, quality, TRUE);
    jpeg_start_compress(&info_, TRUE);
    const std::size_t stride =
        static_cast<std::size_t>(shape.width_px) * static_cast<std::size_t>(shape.channels);
    while (info_.next_scanline < info_.image_height) {
      // libjpeg only reads the rows; its interface is older than const.
      JSAMPROW line = const_cast<JSAMPROW>(samples.data() + stride * info_.next_scanline);
      jpeg_write_scanlines(&info_, &line, 1);
    }
    jpeg_finish_compress(&info_);
    return {bytes_, bytes_ + size_};
  }

 private:
  jpeg_compress_struct info_{};
  jpeg_error_mgr errors_{};
  unsigned char* bytes_ = nullptr;
  unsigned long size_ = 0;
};

}  // namespace

void decode_jpeg(std::span<const std::uint8_t> bytes, RowSink& sink) {
  Decompressor().decode(bytes, sink);
}

Bytes encode_jpeg(const PictureView& picture, int quality) {
  if ((picture.shape.channels != 1 && picture.shape.channels != 3) || picture.shape.bits != 8)
    throw PictureError("a JPEG is written with 8 bits, grey or in colours");
  return Compressor().encode(picture.shape, std::get<std::span<const std::uint8_t>>(picture.samples),
                             quality);
}

}  // namespace lampglow::daemon
