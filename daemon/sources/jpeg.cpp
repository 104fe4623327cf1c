#include "daemon/sources/jpeg.h"

#include <cstdio>
#include <stdexcept>
// jpeglib.h needs size_t and FILE before it.
#include <jerror.h>
#include <jpeglib.h>

namespace lampglow::daemon {
namespace {

struct Damage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// libjpeg is built with unwind tables, so an exception may pass through it (as the manual's longjmp would).
[[noreturn]] void fail(j_common_ptr info) {
  char text[JMSG_LENGTH_MAX];
  info->err->format_message(info, text);
  throw Damage(text);
}

void complain(j_common_ptr info, int level) {
  if (level >= 0) return;  // traces
  // Bytes before the end marker are padding that some cameras write; every other warning means lost data.
  if (info->err->msg_code == JWRN_EXTRANEOUS_DATA && info->err->msg_parm.i[1] == 0xD9) return;
  fail(info);
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

  void decode(std::span<const std::uint8_t> bytes, int width_px, int height_px, JpegPicture& picture) {
    jpeg_mem_src(&info_, bytes.data(), bytes.size());
    jpeg_read_header(&info_, TRUE);
    if (static_cast<int>(info_.image_width) != width_px || static_cast<int>(info_.image_height) != height_px)
      throw Damage("two sizes in one picture");
    if (info_.num_components != 1 && info_.num_components != 3) throw Damage("neither mono nor colour");
    info_.out_color_space = info_.num_components == 1 ? JCS_GRAYSCALE : JCS_EXT_BGR;
    info_.dct_method = JDCT_ISLOW;
    jpeg_start_decompress(&info_);
    picture.width_px = static_cast<int>(info_.output_width);
    picture.height_px = static_cast<int>(info_.output_height);
    picture.channels = info_.output_components;
    const std::size_t stride = std::size_t{info_.output_width} * static_cast<std::size_t>(picture.channels);
    picture.samples.resize(stride * info_.output_height);
    while (info_.output_scanline < info_.output_height) {
      JSAMPROW line = picture.samples.data() + stride * info_.output_scanline;
      jpeg_read_scanlines(&info_, &line, 1);
    }
    jpeg_finish_decompress(&info_);
  }

 private:
  jpeg_decompress_struct info_{};
  jpeg_error_mgr errors_{};
};

}  // namespace

JpegPicture decode_jpeg(std::span<const std::uint8_t> bytes, int width_px, int height_px) {
  JpegPicture picture;
  try {
    Decompressor().decode(bytes, width_px, height_px, picture);
  } catch (const Damage& damage) {
    picture.damage = damage.what();
  }
  return picture;
}

}  // namespace lampglow::daemon
