#include "daemon/sources/live_frame.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

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

TEST(LiveFrame, WhatIsNoPicture) {
  const std::string html = "<html>404</html>";
  EXPECT_EQ(fault_of(Bytes(html.begin(), html.end())), Fault::not_an_image);
  EXPECT_EQ(fault_of({}), Fault::torn);
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
