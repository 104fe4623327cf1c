#include "daemon/pictures/tiff.h"

#include <tiffio.h>

#include <algorithm>

#include "daemon/pictures/tiff_file.h"

namespace lampglow::daemon {
namespace {

template <typename T>
T field(TIFF* tiff, std::uint32_t tag, T otherwise) {
  T value = otherwise;
  return TIFFGetFieldDefaulted(tiff, tag, &value) == 1 ? value : otherwise;
}

struct Layout {
  explicit Layout(TIFF* tiff)
      : width_px(static_cast<int>(field<std::uint32_t>(tiff, TIFFTAG_IMAGEWIDTH, 0))),
        height_px(static_cast<int>(field<std::uint32_t>(tiff, TIFFTAG_IMAGELENGTH, 0))),
        bits(field<std::uint16_t>(tiff, TIFFTAG_BITSPERSAMPLE, 1)),
        channels(field<std::uint16_t>(tiff, TIFFTAG_SAMPLESPERPIXEL, 1)),
        photometric(field<std::uint16_t>(tiff, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK)),
        orientation(field<std::uint16_t>(tiff, TIFFTAG_ORIENTATION, ORIENTATION_TOPLEFT)),
        real(field<std::uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT) == SAMPLEFORMAT_IEEEFP),
        whole(field<std::uint16_t>(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT) == SAMPLEFORMAT_UINT),
        contiguous(field<std::uint16_t>(tiff, TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) ==
                   PLANARCONFIG_CONTIG) {}

  bool grey() const { return photometric == PHOTOMETRIC_MINISBLACK || photometric == PHOTOMETRIC_MINISWHITE; }
  // Samples that are what they look like, and are handed on row by row without a picture in between.
  bool plain() const {
    const bool known = (photometric == PHOTOMETRIC_MINISBLACK && channels == 1) ||
                       (photometric == PHOTOMETRIC_RGB && (channels == 3 || (channels == 4 && bits > 8)));
    return known && contiguous && (real ? bits == 32 || bits == 64 : whole && (bits == 8 || bits == 16));
  }
  bool mirrored() const { return orientation == ORIENTATION_TOPRIGHT || orientation == ORIENTATION_BOTRIGHT; }
  bool upside_down() const {
    return orientation == ORIENTATION_BOTLEFT || orientation == ORIENTATION_BOTRIGHT;
  }

  int width_px, height_px, bits, channels, photometric, orientation;
  bool real, whole, contiguous;
};

// Turns rows the way the picture is meant to be seen.
class Turner {
 public:
  Turner(const Layout& layout, RowSink& sink) : layout_(layout), sink_(sink) {}

  template <typename T>
  void take(int row, std::span<T> samples) const {
    if (layout_.mirrored()) {
      // Backwards sample by sample, then each pixel's samples forwards again.
      std::reverse(samples.begin(), samples.end());
      for (auto pixel = samples.begin(); pixel != samples.end(); pixel += layout_.channels)
        std::reverse(pixel, pixel + layout_.channels);
    }
    const int shown = layout_.upside_down() ? layout_.height_px - 1 - row : row;
    if constexpr (std::is_same_v<T, double>) {
      const std::vector<float> narrow(samples.begin(), samples.end());
      sink_.take(shown, std::span<const float>(narrow));
    } else {
      sink_.take(shown, std::span<const T>(samples));
    }
  }

 private:
  const Layout& layout_;
  RowSink& sink_;
};

template <typename T>
void read_strips(TIFF* tiff, const TiffFile& file, const Layout& layout, const Turner& turner) {
  std::vector<T> samples(static_cast<std::size_t>(layout.width_px) *
                         static_cast<std::size_t>(layout.channels));
  if (TIFFScanlineSize64(tiff) != samples.size() * sizeof(T)) throw PictureError("two sizes in one picture");
  for (int row = 0; row < layout.height_px; ++row) {
    const int result = TIFFReadScanline(tiff, samples.data(), static_cast<std::uint32_t>(row), 0);
    file.check(result == 1);
    turner.take<T>(row, samples);
  }
}

// One row of tiles after the other; the last ones reach beyond the picture.
template <typename T>
void read_tiles(TIFF* tiff, const TiffFile& file, const Layout& layout, const Turner& turner) {
  const int tile_width = static_cast<int>(field<std::uint32_t>(tiff, TIFFTAG_TILEWIDTH, 0));
  const int tile_height = static_cast<int>(field<std::uint32_t>(tiff, TIFFTAG_TILELENGTH, 0));
  const auto length = [&](int pixels) {
    return static_cast<std::size_t>(pixels) * static_cast<std::size_t>(layout.channels);
  };
  const std::size_t stride = length(layout.width_px);
  if (tile_width < 1 || tile_height < 1) throw PictureError("tiles without pixels");
  const std::size_t tile_length = length(tile_width) * static_cast<std::size_t>(tile_height);
  if (TIFFTileSize64(tiff) != tile_length * sizeof(T)) throw PictureError("two sizes in one picture");
  std::vector<T> tile(tile_length);
  std::vector<T> band(stride * static_cast<std::size_t>(std::min(tile_height, layout.height_px)));
  for (int top = 0; top < layout.height_px; top += tile_height) {
    const int rows = std::min(tile_height, layout.height_px - top);
    for (int left = 0; left < layout.width_px; left += tile_width) {
      const tmsize_t result = TIFFReadTile(tiff, tile.data(), static_cast<std::uint32_t>(left),
                                           static_cast<std::uint32_t>(top), 0, 0);
      file.check(result >= 0);
      const std::size_t width = length(std::min(tile_width, layout.width_px - left));
      for (std::size_t row = 0; row < static_cast<std::size_t>(rows); ++row)
        std::copy_n(&tile[row * length(tile_width)], width, &band[row * stride + length(left)]);
    }
    for (int row = 0; row < rows; ++row)
      turner.take<T>(top + row, std::span<T>(band).subspan(static_cast<std::size_t>(row) * stride, stride));
  }
}

template <typename T>
void read_plain(TIFF* tiff, const TiffFile& file, const Layout& layout, RowSink& sink) {
  sink.begin({layout.width_px, layout.height_px, layout.channels, layout.real ? 32 : layout.bits});
  const Turner turner(layout, sink);
  if (TIFFIsTiled(tiff) != 0)
    read_tiles<T>(tiff, file, layout, turner);
  else
    read_strips<T>(tiff, file, layout, turner);
}

// Palettes, few bits, separate planes, other colour spaces: libtiff makes 8-bit colours of them, turned.
void read_as_colours(TIFF* tiff, const TiffFile& file, const Layout& layout, RowSink& sink) {
  if (layout.bits > 8)
    throw PictureError("samples of more than 8 bits that are neither grey nor red, green, blue");
  const bool alpha = layout.channels == 4 && layout.photometric != PHOTOMETRIC_PALETTE;
  const PictureShape shape{layout.width_px, layout.height_px, layout.grey() ? 1 : alpha ? 4 : 3, 8};
  sink.begin(shape);
  const auto width = static_cast<std::size_t>(shape.width_px),
             height = static_cast<std::size_t>(shape.height_px);
  const auto channels = static_cast<std::size_t>(shape.channels);
  std::vector<std::uint32_t> raster(width * height);
  const int result =
      TIFFReadRGBAImageOriented(tiff, static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height),
                                raster.data(), ORIENTATION_TOPLEFT, 1);
  file.check(result == 1);
  std::vector<std::uint8_t> samples(width * channels);
  for (std::size_t row = 0; row < height; ++row) {
    for (std::size_t column = 0; column < width; ++column)
      for (std::size_t channel = 0; channel < channels; ++channel)  // red stands in the lowest bits
        samples[column * channels + channel] =
            static_cast<std::uint8_t>(raster[row * width + column] >> (8 * channel));
    sink.take(static_cast<int>(row), std::span<const std::uint8_t>(samples));
  }
}

}  // namespace

void decode_tiff(std::span<const std::uint8_t> bytes, RowSink& sink) {
  TiffFile file{.source = bytes, .written = {}, .at = 0, .complaint = {}};
  const TiffHandle tiff = open_tiff(file, "r");
  const Layout layout(tiff.get());
  if (layout.width_px < 1 || layout.height_px < 1) throw PictureError("a picture without pixels");
  if (layout.orientation > ORIENTATION_BOTLEFT) throw PictureError("a picture that lies on its side");
  if (!layout.plain()) return read_as_colours(tiff.get(), file, layout, sink);
  if (layout.bits == 8) return read_plain<std::uint8_t>(tiff.get(), file, layout, sink);
  if (layout.bits == 16) return read_plain<std::uint16_t>(tiff.get(), file, layout, sink);
  if (layout.bits == 32) return read_plain<float>(tiff.get(), file, layout, sink);
  read_plain<double>(tiff.get(), file, layout, sink);
}

}  // namespace lampglow::daemon
