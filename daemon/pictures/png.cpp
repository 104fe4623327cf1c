#include "daemon/pictures/png.h"

#include <png.h>

#include <algorithm>
#include <bit>
#include <new>

namespace lampglow::daemon {
namespace {

// libpng is built with unwind tables, so an exception may pass through it (as the manual's longjmp would).
[[noreturn]] void fail(png_structp, png_const_charp text) {
  throw PictureError(text);
}

// What the decoder can do without is no damage: checksums tell of that.
void ignore(png_structp, png_const_charp) {}

class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : rest_(bytes) {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, fail, ignore);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) {
      png_destroy_read_struct(&png_, nullptr, nullptr);
      throw std::bad_alloc();
    }
  }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() { png_destroy_read_struct(&png_, &info_, nullptr); }

  void decode(RowSink& sink) {
    png_set_read_fn(png_, this, read);
    // Texts and profiles, which can grow large, are not even unpacked.
    png_set_keep_unknown_chunks(png_, PNG_HANDLE_CHUNK_NEVER, nullptr, -1);
    png_read_info(png_, info_);
    const int passes = ask_for_plain_samples();
    const PictureShape shape{static_cast<int>(png_get_image_width(png_, info_)),
                             static_cast<int>(png_get_image_height(png_, info_)),
                             static_cast<int>(png_get_channels(png_, info_)),
                             static_cast<int>(png_get_bit_depth(png_, info_))};
    sink.begin(shape);
    if (shape.bits == 16)
      read_rows<std::uint16_t>(shape, passes, sink);
    else
      read_rows<std::uint8_t>(shape, passes, sink);
    png_read_end(png_, nullptr);  // the checksums of what is left
  }

 private:
  static void read(png_structp png, png_bytep data, std::size_t count) {
    auto& self = *static_cast<Reader*>(png_get_io_ptr(png));
    if (count > self.rest_.size()) png_error(png, "the file ends before the picture does");
    std::copy_n(self.rest_.begin(), count, data);
    self.rest_ = self.rest_.subspan(count);
  }

  // 8 or 16 bits, in this machine's order; 1, 3 or 4 channels. Returns the passes of an interlaced picture.
  int ask_for_plain_samples() {
    const int type = png_get_color_type(png_, info_), bits = png_get_bit_depth(png_, info_);
    if (type == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    if (type == PNG_COLOR_TYPE_GRAY && bits < 8) png_set_expand_gray_1_2_4_to_8(png_);
    if (type == PNG_COLOR_TYPE_GRAY_ALPHA) png_set_gray_to_rgb(png_);
    const bool colours = (type & PNG_COLOR_MASK_COLOR) != 0;
    if (colours && png_get_valid(png_, info_, PNG_INFO_tRNS) != 0) png_set_tRNS_to_alpha(png_);
    if (bits == 16 && std::endian::native == std::endian::little) png_set_swap(png_);
    const int passes = png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return passes;
  }

  // An interlaced picture's rows are complete in its last pass: it alone is held as a whole.
  template <typename T>
  void read_rows(const PictureShape& shape, int passes, RowSink& sink) {
    const std::size_t length = png_get_rowbytes(png_, info_) / sizeof(T);
    const std::size_t stride = passes > 1 ? length : 0;
    std::vector<T> samples(passes > 1 ? length * static_cast<std::size_t>(shape.height_px) : length);
    for (int pass = 0; pass < passes; ++pass)
      for (int row = 0; row < shape.height_px; ++row) {
        T* at = samples.data() + stride * static_cast<std::size_t>(row);
        png_read_row(png_, reinterpret_cast<png_bytep>(at), nullptr);
        if (pass + 1 == passes) sink.take(row, std::span<const T>(at, length));
      }
  }

  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
  std::span<const std::uint8_t> rest_;
};

class Writer {
 public:
  Writer() {
    png_ = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, fail, ignore);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
    if (info_ == nullptr) {
      png_destroy_write_struct(&png_, nullptr);
      throw std::bad_alloc();
    }
  }
  Writer(const Writer&) = delete;
  Writer& operator=(const Writer&) = delete;
  ~Writer() { png_destroy_write_struct(&png_, &info_); }

  template <typename T>
  void encode(const PictureShape& shape, std::span<const T> samples, Bytes& out) {
    png_set_write_fn(
        png_, &out,
        [](png_structp png, png_bytep data, std::size_t count) {
          auto& bytes = *static_cast<Bytes*>(png_get_io_ptr(png));
          bytes.insert(bytes.end(), data, data + count);
        },
        nullptr);
    png_set_compression_level(png_, 1);
    png_set_IHDR(png_, info_, static_cast<png_uint_32>(shape.width_px),
                 static_cast<png_uint_32>(shape.height_px), shape.bits,
                 shape.channels == 1 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_write_info(png_, info_);
    if (sizeof(T) == 2 && std::endian::native == std::endian::little) png_set_swap(png_);
    const std::size_t stride =
        static_cast<std::size_t>(shape.width_px) * static_cast<std::size_t>(shape.channels);
    for (std::size_t row = 0; row < static_cast<std::size_t>(shape.height_px); ++row)
      png_write_row(png_, reinterpret_cast<png_const_bytep>(samples.data() + row * stride));
    png_write_end(png_, nullptr);
  }

 private:
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

}  // namespace

void decode_png(std::span<const std::uint8_t> bytes, RowSink& sink) {
  Reader(bytes).decode(sink);
}

Bytes encode_png(const PictureView& picture) {
  if ((picture.shape.channels != 1 && picture.shape.channels != 3) || picture.shape.bits > 16)
    throw PictureError("a PNG is written with 8 or 16 bits, grey or in colours");
  Bytes bytes;
  if (picture.shape.bits == 16)
    Writer().encode(picture.shape, std::get<std::span<const std::uint16_t>>(picture.samples), bytes);
  else
    Writer().encode(picture.shape, std::get<std::span<const std::uint8_t>>(picture.samples), bytes);
  return bytes;
}

}  // namespace lampglow::daemon
