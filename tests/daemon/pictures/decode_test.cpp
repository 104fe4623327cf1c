// Every decoder and encoder against OpenCV's, which this program had before: the same values, pixel by pixel.
#include "daemon/pictures/decode.h"

#include <gmock/gmock.h>
#include <png.h>
#define TIFF_DISABLE_DEPRECATED  // its int64 is not OpenCV's
#include <tiffio.h>

#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "daemon/pictures/exr.h"
#include "daemon/pictures/jpeg.h"
#include "daemon/pictures/png.h"
#include "daemon/pictures/tiff.h"
#include "tests/support/temporary_folder.h"
// jpeglib.h needs size_t and FILE before it.
#include <jpeglib.h>

namespace lampglow::daemon {
namespace {

using test::read_all;
using test::TemporaryFolder;

// 37 x 29: no multiple of a byte's bits, a JPEG's block, a tile.
constexpr int kWidth = 37, kHeight = 29;

cv::Mat noise(int type, double low, double high) {
  cv::Mat picture(kHeight, kWidth, type);
  cv::RNG random(7);
  random.fill(picture, cv::RNG::UNIFORM, cv::Scalar::all(low), cv::Scalar::all(high));
  return picture;
}

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// Keeps a picture as OpenCV would: blue, green, red, alpha.
class MatSink : public RowSink {
 public:
  void begin(const PictureShape& shape) override {
    const int depth = shape.bits == 8 ? CV_8U : shape.bits == 16 ? CV_16U : CV_32F;
    picture = cv::Mat(shape.height_px, shape.width_px, CV_MAKETYPE(depth, shape.channels));
    seen.assign(static_cast<std::size_t>(shape.height_px), 0);
  }
  void take(int row, Samples samples) override {
    ++seen[static_cast<std::size_t>(row)];
    std::visit([&](auto values) { put(row, values); }, samples);
  }

  cv::Mat picture;
  std::vector<int> seen;

 private:
  template <typename T>
  void put(int row, std::span<const T> values) {
    const auto channels = static_cast<std::size_t>(picture.channels());
    ASSERT_EQ(values.size(), static_cast<std::size_t>(picture.cols) * channels);
    ASSERT_EQ(sizeof(T), picture.elemSize1());
    T* to = picture.ptr<T>(row);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::size_t channel = i % channels;
      to[i - channel + (channels >= 3 && channel < 3 ? 2 - channel : channel)] = values[i];
    }
  }
};

cv::Mat decode(std::span<const std::uint8_t> bytes) {
  MatSink sink;
  if (is_exr(bytes)) {
    decode_exr(bytes, sink);
  } else {
    const auto header = read_image_header(bytes);
    if (!header || !header->complete) throw PictureError("no complete header");
    decode_picture(header->format, bytes, sink);
  }
  EXPECT_THAT(sink.seen, testing::Each(1)) << "every row once";
  return sink.picture;
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

// Ours and OpenCV's of the same bytes; `type` is what both are to give.
void expect_as_opencv(const std::string& bytes, int type, const std::string& what) {
  const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
  const cv::Mat theirs = cv::imdecode(raw, cv::IMREAD_UNCHANGED);
  ASSERT_FALSE(theirs.empty()) << what;
  EXPECT_EQ(theirs.type(), type) << what;
  EXPECT_GT(cv::norm(theirs, cv::NORM_INF), 0) << what << ": nothing to compare";
  cv::Mat ours;
  ASSERT_NO_THROW(ours = decode(bytes_of(bytes))) << what;
  EXPECT_TRUE(same(ours, theirs)) << what << ": " << ours.type() << " for " << theirs.type();
}

std::string encoded(const std::string& extension, const cv::Mat& picture,
                    const std::vector<int>& options = {}) {
  std::vector<std::uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(extension, picture, bytes, options));
  return {bytes.begin(), bytes.end()};
}

struct PngKind {
  int colour_type, bits, interlace;
  bool transparent;
};

// Rows of noise, whatever their bits mean.
std::string png_of(const PngKind& kind) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "a.png").string();
  std::FILE* file = std::fopen(path.c_str(), "wb");
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_init_io(png, file);
  png_set_IHDR(png, info, kWidth, kHeight, kind.bits, kind.colour_type, kind.interlace,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  std::vector<png_color> palette(std::size_t{1} << std::min(kind.bits, 8));
  for (std::size_t i = 0; i < palette.size(); ++i)
    palette[i] = {static_cast<png_byte>(i * 3 + 1), static_cast<png_byte>(i * 7),
                  static_cast<png_byte>(255 - i)};
  if (kind.colour_type == PNG_COLOR_TYPE_PALETTE)
    png_set_PLTE(png, info, palette.data(), static_cast<int>(palette.size()));
  const png_byte alpha[] = {0, 128};
  png_color_16 key{};
  key.red = key.green = key.blue = key.gray = 1;
  if (kind.transparent) png_set_tRNS(png, info, alpha, 2, &key);
  png_set_gAMA(png, info, 0.3);
  png_text text{};
  char keyword[] = "Comment", words[] = "not of the picture";
  text.key = keyword;
  text.text = words;
  text.compression = PNG_TEXT_COMPRESSION_NONE;
  png_set_text(png, info, &text, 1);
  png_write_info(png, info);
  std::vector<std::vector<png_byte>> rows(kHeight, std::vector<png_byte>(png_get_rowbytes(png, info)));
  std::vector<png_bytep> starts;
  cv::RNG random(3);
  for (auto& row : rows) {
    for (png_byte& byte : row) byte = static_cast<png_byte>(random.uniform(0, 256));
    starts.push_back(row.data());
  }
  png_write_image(png, starts.data());
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  std::fclose(file);
  return read_all(path);
}

TEST(Pictures, EveryKindOfPngIsWhatOpencvReads) {
  const auto type_of = [](const PngKind& kind) {
    const bool alpha = (kind.colour_type & PNG_COLOR_MASK_ALPHA) != 0 ||
                       (kind.transparent && (kind.colour_type & PNG_COLOR_MASK_COLOR) != 0);
    const int channels = alpha ? 4 : (kind.colour_type & PNG_COLOR_MASK_COLOR) != 0 ? 3 : 1;
    return CV_MAKETYPE(kind.bits == 16 ? CV_16U : CV_8U, channels);
  };
  for (const auto& [colour_type, bits] : {std::pair{PNG_COLOR_TYPE_GRAY, 1},
                                          {PNG_COLOR_TYPE_GRAY, 2},
                                          {PNG_COLOR_TYPE_GRAY, 4},
                                          {PNG_COLOR_TYPE_GRAY, 8},
                                          {PNG_COLOR_TYPE_GRAY, 16},
                                          {PNG_COLOR_TYPE_RGB, 8},
                                          {PNG_COLOR_TYPE_RGB, 16},
                                          {PNG_COLOR_TYPE_RGB_ALPHA, 8},
                                          {PNG_COLOR_TYPE_RGB_ALPHA, 16},
                                          {PNG_COLOR_TYPE_GRAY_ALPHA, 8},
                                          {PNG_COLOR_TYPE_GRAY_ALPHA, 16},
                                          {PNG_COLOR_TYPE_PALETTE, 1},
                                          {PNG_COLOR_TYPE_PALETTE, 2},
                                          {PNG_COLOR_TYPE_PALETTE, 4},
                                          {PNG_COLOR_TYPE_PALETTE, 8}})
    for (const int interlace : {PNG_INTERLACE_NONE, PNG_INTERLACE_ADAM7})
      for (const bool transparent : {false, true}) {
        if (transparent && (colour_type & PNG_COLOR_MASK_ALPHA) != 0) continue;
        const PngKind kind{colour_type, bits, interlace, transparent};
        expect_as_opencv(png_of(kind), type_of(kind),
                         "PNG of type " + std::to_string(colour_type) + ", bits " + std::to_string(bits) +
                             ", interlace " + std::to_string(interlace) + (transparent ? ", tRNS" : ""));
      }
}

// What OpenCV does not write: CMYK and YCCK, of components at any sampling.
std::string jpeg_of(J_COLOR_SPACE in, int components, J_COLOR_SPACE stored, int sampling, bool arithmetic) {
  jpeg_compress_struct info{};
  jpeg_error_mgr errors{};
  info.err = jpeg_std_error(&errors);
  jpeg_create_compress(&info);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&info, &bytes, &size);
  info.image_width = kWidth;
  info.image_height = kHeight;
  info.input_components = components;
  info.in_color_space = in;
  jpeg_set_defaults(&info);
  jpeg_set_colorspace(&info, stored);
  info.comp_info[0].h_samp_factor = info.comp_info[0].v_samp_factor = sampling;
  info.arith_code = arithmetic ? TRUE : FALSE;
  jpeg_start_compress(&info, TRUE);
  cv::RNG random(5);
  std::vector<JSAMPLE> row(static_cast<std::size_t>(kWidth * components));
  while (info.next_scanline < info.image_height) {
    for (JSAMPLE& sample : row) sample = static_cast<JSAMPLE>(random.uniform(0, 256));
    JSAMPROW line = row.data();
    jpeg_write_scanlines(&info, &line, 1);
  }
  jpeg_finish_compress(&info);
  const std::string result(bytes, bytes + size);
  jpeg_destroy_compress(&info);
  std::free(bytes);
  return result;
}

TEST(Pictures, EveryKindOfJpegIsWhatOpencvReads) {
  for (const int type : {CV_8UC1, CV_8UC3})
    for (const int progressive : {0, 1})
      for (const int quality : {30, 92, 100})
        expect_as_opencv(
            encoded(".jpg", noise(type, 0, 256),
                    {cv::IMWRITE_JPEG_QUALITY, quality, cv::IMWRITE_JPEG_PROGRESSIVE, progressive}),
            type, "JPEG of quality " + std::to_string(quality));
  for (const int sampling : {1, 2}) {
    expect_as_opencv(jpeg_of(JCS_RGB, 3, JCS_YCbCr, sampling, false), CV_8UC3, "YCbCr");
    expect_as_opencv(jpeg_of(JCS_CMYK, 4, JCS_CMYK, sampling, false), CV_8UC3, "CMYK");
    expect_as_opencv(jpeg_of(JCS_CMYK, 4, JCS_YCCK, sampling, false), CV_8UC3, "YCCK");
  }
  expect_as_opencv(jpeg_of(JCS_RGB, 3, JCS_RGB, 1, false), CV_8UC3, "RGB");
}

// Orientation 6 ("turn it right") by EXIF: a camera's, which nobody turns here.
TEST(Pictures, ExifOrientationIsLeftOut) {
  std::string bytes = encoded(".jpg", noise(CV_8UC3, 0, 256));
  using namespace std::string_literals;
  bytes.insert(2,
               "\xFF\xE1\0\x22"
               "Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0\0\0\0\0"s);
  const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U, bytes.data());
  ASSERT_EQ(cv::imdecode(raw, cv::IMREAD_COLOR).rows, kWidth) << "the tag is there";
  expect_as_opencv(bytes, CV_8UC3, "EXIF");
}

struct TiffKind {
  int bits, channels, photometric, compression, predictor = 1, tile = 0, orientation = ORIENTATION_TOPLEFT,
                                                planar = PLANARCONFIG_CONTIG;
  bool real = false;
  const char* mode = "w";  // "wb": big endian

  std::string text() const {
    return "TIFF of " + std::to_string(bits) + " bits, channels " + std::to_string(channels) +
           ", photometric " + std::to_string(photometric) + ", compression " + std::to_string(compression) +
           ", predictor " + std::to_string(predictor) + ", tile " + std::to_string(tile) + ", orientation " +
           std::to_string(orientation) + ", planar " + std::to_string(planar) + ", " + mode;
  }
};

std::string tiff_of(const TiffKind& kind) {
  const TemporaryFolder folder;
  const std::string path = (folder.path() / "a.tiff").string();
  TIFF* tiff = TIFFOpen(path.c_str(), kind.mode);
  TIFFSetField(tiff, TIFFTAG_IMAGEWIDTH, kWidth);
  TIFFSetField(tiff, TIFFTAG_IMAGELENGTH, kHeight);
  TIFFSetField(tiff, TIFFTAG_BITSPERSAMPLE, kind.bits);
  TIFFSetField(tiff, TIFFTAG_SAMPLESPERPIXEL, kind.channels);
  TIFFSetField(tiff, TIFFTAG_PHOTOMETRIC, kind.photometric);
  TIFFSetField(tiff, TIFFTAG_ORIENTATION, kind.orientation);
  TIFFSetField(tiff, TIFFTAG_PLANARCONFIG, kind.planar);
  TIFFSetField(tiff, TIFFTAG_COMPRESSION, kind.compression);
  if (kind.predictor > 1) TIFFSetField(tiff, TIFFTAG_PREDICTOR, kind.predictor);
  if (kind.real) TIFFSetField(tiff, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
  if (kind.channels == 4) {
    const std::uint16_t extra[] = {EXTRASAMPLE_UNASSALPHA};
    TIFFSetField(tiff, TIFFTAG_EXTRASAMPLES, 1, extra);
  }
  if (kind.photometric == PHOTOMETRIC_YCBCR) TIFFSetField(tiff, TIFFTAG_YCBCRSUBSAMPLING, 1, 1);
  std::vector<std::uint16_t> map(256);
  for (std::size_t i = 0; i < map.size(); ++i) map[i] = static_cast<std::uint16_t>(65535 - 200 * i);
  if (kind.photometric == PHOTOMETRIC_PALETTE)
    TIFFSetField(tiff, TIFFTAG_COLORMAP, map.data(), map.data(), map.data());
  cv::RNG random(9);
  const auto fill = [&](std::vector<std::uint8_t>& bytes) {
    for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random.uniform(0, 256));
    if (!kind.real) return;
    for (std::size_t i = 0; i < bytes.size() * 8 / static_cast<std::size_t>(kind.bits); ++i) {
      const double value = random.uniform(-2.0, 7.0);
      if (kind.bits == 64)
        reinterpret_cast<double*>(bytes.data())[i] = value;
      else
        reinterpret_cast<float*>(bytes.data())[i] = static_cast<float>(value);
    }
  };
  const int planes = kind.planar == PLANARCONFIG_SEPARATE ? kind.channels : 1;
  if (kind.tile > 0) {
    TIFFSetField(tiff, TIFFTAG_TILEWIDTH, kind.tile);
    TIFFSetField(tiff, TIFFTAG_TILELENGTH, kind.tile);
    std::vector<std::uint8_t> tile(static_cast<std::size_t>(TIFFTileSize(tiff)));
    for (int y = 0; y < kHeight; y += kind.tile)
      for (int x = 0; x < kWidth; x += kind.tile) {
        fill(tile);
        TIFFWriteTile(tiff, tile.data(), static_cast<std::uint32_t>(x), static_cast<std::uint32_t>(y), 0, 0);
      }
  } else {
    TIFFSetField(tiff, TIFFTAG_ROWSPERSTRIP, 8);
    std::vector<std::uint8_t> row(static_cast<std::size_t>(TIFFScanlineSize(tiff)));
    for (int plane = 0; plane < planes; ++plane)
      for (int y = 0; y < kHeight; ++y) {
        fill(row);
        TIFFWriteScanline(tiff, row.data(), static_cast<std::uint32_t>(y), static_cast<std::uint16_t>(plane));
      }
  }
  TIFFClose(tiff);
  return read_all(path);
}

// OpenCV 4.6 fails at tiles of 8 bits that are not packed: the same samples packed are its picture then.
void expect_tiff_as_opencv(const TiffKind& kind, int type) {
  if (kind.tile == 0 || kind.bits > 8 || kind.compression != COMPRESSION_NONE)
    return expect_as_opencv(tiff_of(kind), type, kind.text());
  TiffKind packed = kind;
  packed.compression = COMPRESSION_LZW;
  const std::string bytes = tiff_of(packed);
  const cv::Mat raw(1, static_cast<int>(bytes.size()), CV_8U, const_cast<char*>(bytes.data()));
  EXPECT_TRUE(same(decode(bytes_of(tiff_of(kind))), cv::imdecode(raw, cv::IMREAD_UNCHANGED))) << kind.text();
}

TEST(Pictures, TiffOfEveryUsualPackingIsWhatOpencvReads) {
  for (const int bits : {8, 16})
    for (const int channels : {1, 3})
      for (const auto& [compression, predictor] : {std::pair{COMPRESSION_NONE, 1},
                                                   {COMPRESSION_LZW, 1},
                                                   {COMPRESSION_LZW, 2},
                                                   {COMPRESSION_PACKBITS, 1},
                                                   {COMPRESSION_ADOBE_DEFLATE, 1},
                                                   {COMPRESSION_ADOBE_DEFLATE, 2},
                                                   {COMPRESSION_ZSTD, 1}})
        for (const int tile : {0, 16})
          for (const char* mode : {"w", "wb"})
            expect_tiff_as_opencv({.bits = bits,
                                   .channels = channels,
                                   .photometric = channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
                                   .compression = compression,
                                   .predictor = predictor,
                                   .tile = tile,
                                   .mode = mode},
                                  CV_MAKETYPE(bits == 8 ? CV_8U : CV_16U, channels));
}

TEST(Pictures, TiffOfOtherColoursIsWhatOpencvReads) {
  const int none = COMPRESSION_NONE;
  expect_tiff_as_opencv({8, 1, PHOTOMETRIC_MINISWHITE, none}, CV_8UC1);
  expect_tiff_as_opencv({1, 1, PHOTOMETRIC_MINISBLACK, none}, CV_8UC1);
  expect_tiff_as_opencv({1, 1, PHOTOMETRIC_MINISWHITE, COMPRESSION_CCITTFAX4}, CV_8UC1);
  expect_tiff_as_opencv({8, 1, PHOTOMETRIC_PALETTE, none}, CV_8UC3);
  expect_tiff_as_opencv({8, 3, PHOTOMETRIC_YCBCR, none}, CV_8UC3);
  expect_tiff_as_opencv({8, 1, PHOTOMETRIC_MINISBLACK, COMPRESSION_JPEG}, CV_8UC1);
  expect_tiff_as_opencv({8, 3, PHOTOMETRIC_RGB, COMPRESSION_JPEG}, CV_8UC3);
  expect_tiff_as_opencv({8, 3, PHOTOMETRIC_YCBCR, COMPRESSION_JPEG}, CV_8UC3);
  expect_tiff_as_opencv({8, 4, PHOTOMETRIC_RGB, none}, CV_8UC4);
  expect_tiff_as_opencv({16, 4, PHOTOMETRIC_RGB, none}, CV_16UC4);
  expect_tiff_as_opencv({.bits = 8,
                         .channels = 3,
                         .photometric = PHOTOMETRIC_RGB,
                         .compression = none,
                         .planar = PLANARCONFIG_SEPARATE},
                        CV_8UC3);
}

// OpenCV 4.6 mirrors 8-bit tiles each in its place; so the picture that is not turned, flipped, is the truth.
TEST(Pictures, TiffThatIsTurnedIsShownAsItStood) {
  struct Turn {
    int orientation, flip;
  };
  for (const int bits : {8, 16})
    for (const int channels : {1, 3})
      for (const int tile : {0, 16})
        for (const Turn turn :
             {Turn{ORIENTATION_TOPRIGHT, 1}, {ORIENTATION_BOTRIGHT, -1}, {ORIENTATION_BOTLEFT, 0}}) {
          TiffKind kind{.bits = bits,
                        .channels = channels,
                        .photometric = channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
                        .compression = COMPRESSION_LZW,
                        .tile = tile};
          cv::Mat upright;
          cv::flip(decode(bytes_of(tiff_of(kind))), upright, turn.flip);
          kind.orientation = turn.orientation;
          const std::string bytes = tiff_of(kind);
          EXPECT_TRUE(same(decode(bytes_of(bytes)), upright)) << kind.text();
          if (bits == 16 || tile == 0) expect_as_opencv(bytes, upright.type(), kind.text());
        }
  TiffKind palette{8, 1, PHOTOMETRIC_PALETTE, COMPRESSION_NONE};
  palette.orientation = ORIENTATION_BOTRIGHT;
  expect_tiff_as_opencv(palette, CV_8UC3);
}

TEST(Pictures, TiffOfRealSamplesIsWhatOpencvReads) {
  for (const int channels : {1, 3})
    for (const int tile : {0, 16})
      for (const int predictor : {1, 3})
        expect_tiff_as_opencv({.bits = 32,
                               .channels = channels,
                               .photometric = channels == 1 ? PHOTOMETRIC_MINISBLACK : PHOTOMETRIC_RGB,
                               .compression = COMPRESSION_LZW,
                               .predictor = predictor,
                               .tile = tile,
                               .real = true},
                              CV_MAKETYPE(CV_32F, channels));
  const std::string wide = tiff_of({.bits = 64,
                                    .channels = 1,
                                    .photometric = PHOTOMETRIC_MINISBLACK,
                                    .compression = COMPRESSION_NONE,
                                    .real = true});
  const cv::Mat raw(1, static_cast<int>(wide.size()), CV_8U, const_cast<char*>(wide.data()));
  cv::Mat theirs;
  cv::imdecode(raw, cv::IMREAD_UNCHANGED).convertTo(theirs, CV_32F);
  EXPECT_TRUE(same(decode(bytes_of(wide)), theirs));
}

std::string complaint_of(const std::string& bytes) {
  try {
    decode(bytes_of(bytes));
  } catch (const PictureError& error) {
    return error.what();
  }
  return "";
}

TEST(Pictures, WhatATiffCannotBeTakenAsIsTold) {
  EXPECT_EQ(complaint_of(tiff_of({.bits = 8,
                                  .channels = 1,
                                  .photometric = PHOTOMETRIC_MINISBLACK,
                                  .compression = COMPRESSION_NONE,
                                  .orientation = ORIENTATION_LEFTTOP})),
            "a picture that lies on its side");
  EXPECT_EQ(complaint_of(tiff_of({16, 1, PHOTOMETRIC_MINISWHITE, COMPRESSION_NONE})),
            "samples of more than 8 bits that are neither grey nor red, green, blue");
}

// Also those behind the last row: a picture is taken as a whole or not at all, and nothing is printed of it.
TEST(Pictures, DamageIsToldAndNothingIsPrinted) {
  testing::internal::CaptureStderr();
  const cv::Mat picture = noise(CV_8UC1, 0, 256);
  std::string png = encoded(".png", picture);
  png[png.size() - 20] = static_cast<char>(png[png.size() - 20] ^ 1);  // in the last chunk of data
  EXPECT_NE(complaint_of(png), "");
  std::string jpeg = encoded(".jpg", picture);
  jpeg.replace(jpeg.size() * 2 / 3, std::string::npos, "\xFF\xD9");  // half the data, but an end
  EXPECT_NE(complaint_of(jpeg), "");
  std::string tiff = tiff_of({8, 1, PHOTOMETRIC_MINISBLACK, COMPRESSION_ADOBE_DEFLATE});
  for (std::size_t at = 100; at < 200; ++at) tiff[at] = static_cast<char>(tiff[at] ^ 0x5A);
  EXPECT_NE(complaint_of(tiff), "");
  std::string palette = tiff_of({8, 1, PHOTOMETRIC_PALETTE, COMPRESSION_ADOBE_DEFLATE});
  for (std::size_t at = 100; at < 200; ++at) palette[at] = static_cast<char>(palette[at] ^ 0x5A);
  EXPECT_NE(complaint_of(palette), "");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

class RefusingSink : public RowSink {
 public:
  void begin(const PictureShape&) override { throw PictureError("unwanted"); }
  void take(int, Samples) override { FAIL() << "nothing was to be decoded"; }
};

TEST(Pictures, WhatTheSinkThrowsPassesThroughEveryDecoder) {
  const cv::Mat picture = noise(CV_8UC3, 0, 256);
  for (const char* extension : {".png", ".jpg", ".tiff"}) {
    const std::string bytes = encoded(extension, picture);
    RefusingSink sink;
    EXPECT_THROW(decode_picture(read_image_header(bytes_of(bytes))->format, bytes_of(bytes), sink),
                 PictureError)
        << extension;
  }
}

// --- what is written

template <typename T>
PictureView view_of(const cv::Mat& picture, int bits) {
  return {
      {picture.cols, picture.rows, picture.channels(), bits},
      std::span<const T>(picture.ptr<T>(), picture.total() * static_cast<std::size_t>(picture.channels()))};
}

PictureView view_of(const cv::Mat& picture) {
  if (picture.depth() == CV_8U) return view_of<std::uint8_t>(picture, 8);
  if (picture.depth() == CV_16U) return view_of<std::uint16_t>(picture, 16);
  return view_of<float>(picture, 32);
}

cv::Mat in_opencv_order(const cv::Mat& picture) {
  if (picture.channels() == 1) return picture;
  std::vector<cv::Mat> channels;
  cv::split(picture, channels);
  std::swap(channels[0], channels[2]);
  cv::Mat swapped;
  cv::merge(channels, swapped);
  return swapped;
}

void expect_opencv_reads(const Bytes& bytes, const cv::Mat& picture, const std::string& what) {
  EXPECT_TRUE(same(cv::imdecode(bytes, cv::IMREAD_UNCHANGED), in_opencv_order(picture))) << what;
  EXPECT_TRUE(same(decode(bytes), in_opencv_order(picture))) << what << ", by ourselves";
}

TEST(Pictures, WhatIsWrittenIsWhatOpencvReads) {
  setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 1);  // Debian's OpenCV has OpenEXR, switched off by default
  for (const int type : {CV_8UC1, CV_8UC3, CV_16UC1, CV_16UC3}) {
    const cv::Mat picture = noise(type, 0, CV_MAT_DEPTH(type) == CV_8U ? 256 : 65536);
    expect_opencv_reads(encode_png(view_of(picture)), picture, "PNG " + std::to_string(type));
    expect_opencv_reads(encode_tiff(view_of(picture)), picture, "TIFF " + std::to_string(type));
  }
  for (const int type : {CV_32FC1, CV_32FC3}) {
    const cv::Mat picture = noise(type, -3, 1e6);
    expect_opencv_reads(encode_tiff(view_of(picture)), picture, "TIFF " + std::to_string(type));
    expect_opencv_reads(encode_exr(view_of(picture)), picture, "EXR " + std::to_string(type));
  }
}

TEST(Pictures, ExrIsWhatOpencvWrote) {
  setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 1);
  for (const int type : {CV_32FC1, CV_32FC3})
    for (const int stored : {cv::IMWRITE_EXR_TYPE_HALF, cv::IMWRITE_EXR_TYPE_FLOAT})
      expect_as_opencv(encoded(".exr", noise(type, -3, 1000), {cv::IMWRITE_EXR_TYPE, stored}), type,
                       "EXR " + std::to_string(type) + " stored as " + std::to_string(stored));
  EXPECT_NE(complaint_of(encoded(".exr", noise(CV_32FC3, 0, 1)).substr(0, 2000)), "");
}

// The same library with the same settings: the very bytes.
TEST(Pictures, JpegIsWrittenAsOpencvWritesIt) {
  for (const int type : {CV_8UC1, CV_8UC3})
    for (const int quality : {30, 82, 92}) {
      const cv::Mat picture = noise(type, 0, 256);
      const Bytes ours = encode_jpeg(view_of(picture), quality);
      EXPECT_EQ(std::string(ours.begin(), ours.end()),
                encoded(".jpg", in_opencv_order(picture), {cv::IMWRITE_JPEG_QUALITY, quality}));
    }
}

TEST(Pictures, WhatAFormatCannotHoldIsRefused) {
  const cv::Mat real = noise(CV_32FC1, 0, 1), alpha = noise(CV_8UC4, 0, 256),
                deep = noise(CV_16UC1, 0, 65536);
  EXPECT_THROW(encode_png(view_of(real)), PictureError);
  EXPECT_THROW(encode_png(view_of(alpha)), PictureError);
  EXPECT_THROW(encode_jpeg(view_of(deep), 92), PictureError);
  EXPECT_THROW(encode_tiff(view_of(alpha)), PictureError);
  EXPECT_THROW(encode_exr(view_of(deep)), PictureError);
}

}  // namespace
}  // namespace lampglow::daemon
