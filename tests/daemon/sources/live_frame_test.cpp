#include "daemon/sources/live_frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "daemon/sources/fault.h"

namespace lampglow::daemon {
namespace {

using Bytes = std::vector<std::uint8_t>;

cv::Mat noise(int type, double mean = 90) {
  cv::Mat picture(60, 80, type);
  cv::RNG random(5);
  random.fill(picture, cv::RNG::NORMAL, cv::Scalar::all(mean), cv::Scalar::all(mean / 5));
  return picture;
}

Bytes encode(const char* extension, const cv::Mat& picture, const std::vector<int>& options = {}) {
  Bytes bytes;
  cv::imencode(extension, picture, bytes, options);
  return bytes;
}

Exposure decode(const Bytes& bytes, std::size_t max_pixels = 1'000'000) {
  return decode_live_frame(bytes, "picture", max_pixels);
}

Fault fault_of(const Bytes& bytes, std::size_t max_pixels = 1'000'000) {
  try {
    decode(bytes, max_pixels);
  } catch (const SourceError& error) {
    return error.fault();
  }
  return Fault::none;
}

TEST(LiveFrame, SixteenBitPngAndTiffAreExact) {
  const cv::Mat picture = noise(CV_16UC1, 3000);
  for (const char* extension : {".png", ".tiff"}) {
    const Exposure image = decode(encode(extension, picture));
    EXPECT_EQ(image.pixels.width_px, 80);
    EXPECT_TRUE(image.monochrome);
    for (int row = 0; row < 60; ++row)
      for (int column = 0; column < 80; ++column)
        ASSERT_EQ(image.pixels.at(column, row), picture.at<std::uint16_t>(row, column)) << extension;
  }
}

TEST(LiveFrame, ColourGivesGreen) {
  const cv::Mat picture = noise(CV_8UC3);
  for (const char* extension : {".png", ".tiff"}) {
    const Exposure image = decode(encode(extension, picture));
    EXPECT_FALSE(image.monochrome);
    EXPECT_EQ(image.pixels.at(7, 9), picture.at<cv::Vec3b>(9, 7)[1]);
  }
}

TEST(LiveFrame, JpegIsWhatOpencvReads) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const Bytes bytes = encode(".jpg", noise(type));
    const cv::Mat other = cv::imdecode(bytes, cv::IMREAD_COLOR);
    const Exposure image = decode(bytes);
    EXPECT_EQ(image.monochrome, type == CV_8UC1);
    for (int row = 0; row < 60; ++row)
      for (int column = 0; column < 80; ++column)
        ASSERT_EQ(image.pixels.at(column, row), other.at<cv::Vec3b>(row, column)[1]);
  }
}

TEST(LiveFrame, GreyColourJpegIsMonochrome) {
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>(3, noise(CV_8UC1)), colour);
  EXPECT_TRUE(decode(encode(".png", colour)).monochrome);
}

TEST(LiveFrame, CutAnywhereIsAnError) {
  for (const char* extension : {".jpg", ".png", ".tiff"}) {
    const Bytes whole = encode(extension, noise(CV_8UC3));
    for (std::size_t tenth = 0; tenth < 10; ++tenth) {
      const Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(whole.size() * tenth / 10));
      EXPECT_NE(fault_of(cut), Fault::none) << extension << " " << tenth;
    }
  }
}

TEST(LiveFrame, CutJpegIsTornAlsoWithAnEndMarkerPutOn) {
  Bytes bytes = encode(".jpg", noise(CV_8UC3));
  bytes.resize(bytes.size() * 2 / 3);
  EXPECT_EQ(fault_of(bytes), Fault::torn);
  bytes.insert(bytes.end(), {0xFF, 0xD9});  // half-decoded: libjpeg only warns
  EXPECT_EQ(fault_of(bytes), Fault::torn);
}

TEST(LiveFrame, PaddingAfterTheEndIsHarmless) {
  Bytes bytes = encode(".jpg", noise(CV_8UC3));
  bytes.resize(bytes.size() + 500, 0);
  EXPECT_EQ(decode(bytes).pixels.width_px, 80);
}

TEST(LiveFrame, BombIsRefusedByItsHeader) {
  for (const char* extension : {".jpg", ".png", ".tiff"}) {
    const Bytes bytes = encode(extension, cv::Mat::zeros(3000, 3000, CV_8UC1));
    EXPECT_EQ(fault_of(bytes), Fault::too_large) << extension;
  }
}

// A TIFF of so many entries (tag, LONG, value) and one strip of 4x4 bytes.
Bytes tiff_of(const std::vector<std::pair<std::uint32_t, std::uint32_t>>& entries) {
  Bytes bytes{'I', 'I', 42, 0, 24, 0, 0, 0};
  for (int i = 0; i < 16; ++i) bytes.push_back(static_cast<std::uint8_t>(10 * i));
  const auto put = [&bytes](std::uint32_t value, int count) {
    for (int i = 0; i < count; ++i) bytes.push_back(static_cast<std::uint8_t>(value >> (8 * i)));
  };
  put(static_cast<std::uint32_t>(entries.size()), 2);
  for (const auto& [tag, value] : entries) {
    put(tag, 2);
    put(4, 2);
    put(1, 4);
    put(value, 4);
  }
  put(0, 4);
  return bytes;
}

TEST(LiveFrame, TiffWhoseStripOrTileIsABombIsRefused) {
  const auto with_rows = [](std::uint32_t rows) {
    return tiff_of({{256, 4}, {257, 4}, {258, 8}, {259, 1}, {262, 1}, {273, 8}, {278, rows}, {279, 16}});
  };
  EXPECT_EQ(fault_of(with_rows(4)), Fault::none);
  EXPECT_EQ(fault_of(with_rows(0xFFFF'FFFF)), Fault::none) << "all rows";
  EXPECT_EQ(fault_of(with_rows(2'555'920)), Fault::torn);  // found by the fuzzer: OpenCV made room for them
  EXPECT_EQ(fault_of(tiff_of({{256, 4},
                              {257, 4},
                              {258, 8},
                              {259, 1},
                              {262, 1},
                              {322, 1 << 20},
                              {323, 1 << 20},
                              {324, 8},
                              {325, 16}})),
            Fault::torn);
}

TEST(LiveFrame, PictureOfTwoSizesIsRefusedBeforeItIsDecoded) {
  EXPECT_EQ(fault_of(tiff_of(
                {{256, 4}, {256, 4}, {257, 4}, {258, 8}, {259, 1}, {262, 1}, {273, 8}, {278, 4}, {279, 16}})),
            Fault::torn);
  // A frame header for arithmetic coding, which our reader of headers does not know but libjpeg does, in
  // place of the picture's own, which comes after the first scan.
  Bytes bytes = encode(".jpg", cv::Mat::zeros(60, 80, CV_8UC1));
  const Bytes huge{0xFF, 0xC9, 0, 11, 8, 0xFF, 0xDC, 0xFF, 0xDC, 1, 1, 0x11, 0,  // 65500 x 65500
                   0xFF, 0xDA, 0, 8,  1, 1,    0,    0,    63,   0};
  const Bytes own{0xFF, 0xC0};
  bytes.insert(std::search(bytes.begin(), bytes.end(), own.begin(), own.end()), huge.begin(), huge.end());
  EXPECT_EQ(fault_of(bytes), Fault::torn);
}

TEST(LiveFrame, WhatIsNoPicture) {
  const std::string html = "<html>404</html>";
  EXPECT_EQ(fault_of(Bytes(html.begin(), html.end())), Fault::not_an_image);
  EXPECT_EQ(fault_of({}), Fault::torn);
}

// As a bad line does: one byte in so many, from any byte on; and every single byte.
TEST(LiveFrame, BytesChangedAnywhereGiveAPictureOrAReason) {
  cv::Mat picture;
  cv::resize(noise(CV_8UC3), picture, {24, 16});
  for (const char* extension : {".jpg", ".png", ".tiff"}) {
    const Bytes whole = encode(extension, picture);
    const auto size = whole.size();
    int refused = 0, changed = 0;
    for (const std::size_t period : {size, std::size_t{97}, std::size_t{31}}) {
      for (std::size_t from = 0; from < std::min(period, size); ++from) {
        for (const std::uint8_t mask : {0x01, 0x55, 0x80, 0xFF}) {
          Bytes bytes = whole;
          for (std::size_t at = from; at < size; at += period) bytes[at] ^= mask;
          refused += fault_of(bytes) != Fault::none;  // throws nothing but SourceError
          ++changed;
        }
      }
    }
    EXPECT_GT(refused, 0) << extension;
    // A PNG has checksums: nothing changed is taken for a picture.
    if (extension == std::string(".png")) {
      EXPECT_EQ(refused, changed);
    }
  }
}

TEST(LiveFrame, FlippedBytesNeverCrash) {
  for (const char* extension : {".jpg", ".png", ".tiff"}) {
    const Bytes whole = encode(extension, noise(CV_8UC3));
    cv::RNG random(11);
    for (int i = 0; i < 300; ++i) {
      Bytes bytes = whole;
      for (int flips = 0; flips < 4; ++flips) {
        bytes[static_cast<std::size_t>(random.uniform(0, static_cast<int>(bytes.size())))] =
            static_cast<std::uint8_t>(random.uniform(0, 256));
      }
      fault_of(bytes);
    }
  }
}

}  // namespace
}  // namespace lampglow::daemon
