#include "daemon/pictures/tiff.h"
#include "daemon/pictures/tiff_file.h"

namespace lampglow::daemon {
namespace {

template <typename T>
void write_rows(TIFF* tiff, const TiffFile& file, const PictureShape& shape, std::span<const T> samples) {
  const std::size_t stride =
      static_cast<std::size_t>(shape.width_px) * static_cast<std::size_t>(shape.channels);
  for (int row = 0; row < shape.height_px; ++row) {
    // A copy: libtiff's predictor works on the row itself.
    const auto* from = samples.data() + static_cast<std::size_t>(row) * stride;
    std::vector<T> line(from, from + stride);
    const int result = TIFFWriteScanline(tiff, line.data(), static_cast<std::uint32_t>(row), 0);
    file.check(result == 1);
  }
}

}  // namespace

Bytes encode_tiff(const PictureView& picture) {
  const PictureShape& shape = picture.shape;
  if (shape.channels != 1 && shape.channels != 3) throw PictureError("a TIFF is written grey or in colours");
  const bool real = shape.bits == 32;
  TiffFile file;
  {
    const TiffHandle tiff = open_tiff(file, "w");
    const auto set = [&](std::uint32_t tag, int value) {
      file.check(TIFFSetField(tiff.get(), tag, value) == 1);
    };
    set(TIFFTAG_IMAGEWIDTH, shape.width_px);
    set(TIFFTAG_IMAGELENGTH, shape.height_px);
    set(TIFFTAG_BITSPERSAMPLE, shape.bits);
    set(TIFFTAG_SAMPLESPERPIXEL, shape.channels);
    set(TIFFTAG_SAMPLEFORMAT, real ? SAMPLEFORMAT_IEEEFP : SAMPLEFORMAT_UINT);
    set(TIFFTAG_PHOTOMETRIC, shape.channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB);
    set(TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG);
    set(TIFFTAG_COMPRESSION, COMPRESSION_LZW);
    set(TIFFTAG_PREDICTOR, real ? PREDICTOR_FLOATINGPOINT : PREDICTOR_HORIZONTAL);
    set(TIFFTAG_ROWSPERSTRIP, static_cast<int>(TIFFDefaultStripSize(tiff.get(), 0)));
    std::visit([&](auto samples) { write_rows(tiff.get(), file, shape, samples); }, picture.samples);
    file.check(TIFFFlush(tiff.get()) == 1);
  }
  file.check(true);  // closing writes as well
  return std::move(file.written);
}

}  // namespace lampglow::daemon
