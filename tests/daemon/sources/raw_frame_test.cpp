#include "daemon/sources/raw_frame.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "daemon/sources/fault.h"

namespace lampglow::daemon {
namespace {

using Bytes = std::vector<std::uint8_t>;

Exposure decode(const char* fourcc, int width, int height, std::size_t stride, const Bytes& bytes,
                YuvCoding coding = {}) {
  return decode_raw_frame({find_raw_format(fourcc), width, height, stride, coding, bytes}, "frame",
                          1'000'000);
}

std::vector<std::uint16_t> values(const Exposure& exposure) {
  const auto& pixels = exposure.pixels.pixels;
  return {pixels.begin(), pixels.end()};
}

TEST(RawFrame, GreyWithPaddedLines) {
  EXPECT_EQ(values(decode("GREY", 2, 2, 3, {1, 2, 99, 3, 4})), (std::vector<std::uint16_t>{1, 2, 3, 4}));
}

TEST(RawFrame, SixteenBitsEitherEndFirst) {
  EXPECT_EQ(values(decode("Y12 ", 2, 1, 4, {0x34, 0x02, 0xFF, 0x0F})),
            (std::vector<std::uint16_t>{0x234, 0xFFF}));
  EXPECT_EQ(values(decode("Y16\xA0", 2, 1, 4, {0x12, 0x34, 0xFF, 0x0F})),
            (std::vector<std::uint16_t>{0x1234, 0xFF0F}));
}

TEST(RawFrame, PackedTenBits) {
  // Samples 0x3FF, 0x000, 0x155, 0x2AA: high bytes FF 00 55 AA, low bits 3 0 1 2.
  EXPECT_EQ(values(decode("Y10P", 4, 1, 5, {0xFF, 0x00, 0x55, 0xAA, 0b10'01'00'11})),
            (std::vector<std::uint16_t>{0x3FF, 0x000, 0x155, 0x2AA}));
}

TEST(RawFrame, PackedTwelveBits) {
  EXPECT_EQ(values(decode("pgCC", 2, 1, 3, {0xAB, 0x12, 0x3C}))[0], 0xABC);
  EXPECT_EQ(values(decode("Y12P", 2, 1, 3, {0xAB, 0x12, 0x3C})), (std::vector<std::uint16_t>{0xABC, 0x123}));
}

TEST(RawFrame, BayerKeepsGreenAndFillsBetween) {
  // RGGB: R G R / G B G / R G R with green 10 and the others 200.
  const Bytes mosaic{200, 10, 200, 10, 200, 10, 200, 10, 200};
  const Exposure rggb = decode("RGGB", 3, 3, 3, mosaic);
  for (const auto value : values(rggb)) EXPECT_EQ(value, 10);
  EXPECT_FALSE(rggb.monochrome);
  for (const auto value : values(decode("GRBG", 3, 3, 3, mosaic))) EXPECT_EQ(value, 200);
}

TEST(RawFrame, LimitedRangeYuv) {
  EXPECT_EQ(values(decode("YUYV", 2, 1, 4, {16, 128, 235, 128})), (std::vector<std::uint16_t>{0, 255}));
  EXPECT_EQ(values(decode("UYVY", 2, 1, 4, {128, 16, 128, 235})), (std::vector<std::uint16_t>{0, 255}));
  EXPECT_TRUE(decode("YUYV", 2, 1, 4, {16, 128, 235, 128}).monochrome);
}

TEST(RawFrame, GreenOfColoursByTheStandard) {
  // BT.601 limited range, 100 % bars (ITU-R BT.801): Y Cb Cr of green, red, blue and white.
  const auto green = [](std::uint8_t y, std::uint8_t cb, std::uint8_t cr) {
    return values(decode("YUYV", 2, 1, 4, {y, cb, y, cr}))[0];
  };
  EXPECT_NEAR(green(145, 54, 34), 255, 1);
  EXPECT_NEAR(green(81, 90, 240), 0, 1);
  EXPECT_NEAR(green(41, 240, 110), 0, 1);
  EXPECT_NEAR(green(235, 128, 128), 255, 1);
}

TEST(RawFrame, Nv12TakesChromaFromItsPlane) {
  const YuvCoding full{.full_range = true};
  const Bytes bytes{100, 100, 100, 100, 128, 128};
  EXPECT_EQ(values(decode("NV12", 2, 2, 2, bytes, full)), (std::vector<std::uint16_t>(4, 100)));
  EXPECT_FALSE(decode("NV12", 2, 2, 2, {100, 100, 100, 100, 90, 128}, full).monochrome);
}

TEST(RawFrame, MissingBytesAreTorn) {
  for (const RawFormat& format : raw_formats()) {
    try {
      decode_raw_frame({&format, 64, 64, 128, {}, Bytes(64 * 64 / 2)}, "frame", 1'000'000);
      ADD_FAILURE() << format.fourcc;
    } catch (const SourceError& error) {
      EXPECT_TRUE(error.fault() == Fault::torn || error.fault() == Fault::not_an_image) << format.fourcc;
    }
  }
}

// The name says it all: S, the first two rows' colours, bits, packing.
TEST(RawFrame, LibcameraNamesAreTheirFormats) {
  for (const std::string order : {"RGGB", "BGGR", "GRBG", "GBRG"}) {
    for (const int bits : {8, 10, 12, 16}) {
      for (const std::string packing : {"", "_CSI2P"}) {
        const bool packed = !packing.empty();
        if (packed && bits != 10 && bits != 12) continue;
        const std::string name = fmt::format("S{}{}{}", order, bits, packing);
        const RawFormat* format = find_libcamera_format(name);
        ASSERT_NE(format, nullptr) << name;
        EXPECT_EQ(format->bits, bits) << name;
        EXPECT_TRUE(format->bayer) << name;
        EXPECT_EQ(format->green_at_even, order[0] == 'G') << name;
        EXPECT_EQ(format->kind == RawKind::packed10 || format->kind == RawKind::packed12, packed) << name;
      }
    }
  }
  EXPECT_EQ(find_libcamera_format("R12")->bits, 12);
  EXPECT_FALSE(find_libcamera_format("R12")->bayer);
  EXPECT_EQ(find_libcamera_format("MJPEG")->kind, RawKind::jpeg);
  EXPECT_EQ(find_libcamera_format("SBGGR10_IPU3"), nullptr);
}

TEST(RawFrame, EveryNameIsThereOnce) {
  for (const RawFormat& format : raw_formats()) {
    EXPECT_EQ(format.fourcc.size(), 4u);
    EXPECT_EQ(find_raw_format(format.fourcc), &format);
  }
  EXPECT_EQ(find_raw_format("XYZW"), nullptr);
}

}  // namespace
}  // namespace lampglow::daemon
