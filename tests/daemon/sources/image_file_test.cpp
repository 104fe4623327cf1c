#include "daemon/sources/image_file.h"

#include <gmock/gmock.h>
#include <sys/stat.h>

#include <map>
#include <random>

#include "daemon/pictures/image_header.h"
#include "tests/support/messages.h"
#include "tests/support/small_archive.h"

namespace lampglow::daemon {
namespace {

using test::encoded;
using test::small_picture;
using test::TemporaryFolder;

Camera camera(int bit_depth) {
  Camera c;
  c.width_px = 64;
  c.height_px = 48;
  c.bit_depth = bit_depth;
  return c;
}

std::span<const std::uint8_t> bytes_of(const std::string& text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

DecodedImage decode(const std::string& bytes, int bit_depth) {
  return decode_image(bytes_of(bytes), "a.png", camera(bit_depth));
}

TEST(ImageFile, DecodesMonoAndTakesTheGreenOfColours) {
  for (const char* extension : {".png", ".tiff"}) {
    const DecodedImage mono = decode(encoded(small_picture(CV_8UC1), extension), 8);
    ASSERT_EQ(mono.fault, "") << extension;
    EXPECT_EQ(mono.pixels.at(7, 3), 13);
    EXPECT_TRUE(mono.monochrome);
    const DecodedImage colour = decode(encoded(small_picture(CV_8UC3), extension), 8);
    ASSERT_EQ(colour.fault, "") << extension;
    EXPECT_EQ(colour.pixels.at(7, 3), 13) << "green, not red or blue";
    EXPECT_FALSE(colour.monochrome);
    const DecodedImage deep = decode(encoded(small_picture(CV_16UC1), extension), 12);
    ASSERT_EQ(deep.fault, "") << extension;
    EXPECT_EQ(deep.pixels.at(7, 3), 13 * 16) << "digital numbers are not scaled";
  }
  EXPECT_EQ(decode(encoded(small_picture(CV_8UC1), ".jpg"), 8).fault, "");
}

TEST(ImageFile, AColourPictureWithEqualChannelsIsMonochrome) {
  cv::Mat grey;
  cv::merge(std::vector<cv::Mat>(3, small_picture(CV_8UC1)), grey);
  EXPECT_TRUE(decode(encoded(grey, ".png"), 8).monochrome);
  EXPECT_TRUE(decode(encoded(grey, ".jpg"), 8).monochrome);
}

TEST(ImageFile, ProgressiveJpegIsRead) {
  const std::string bytes = encoded(small_picture(CV_8UC3), ".jpg", {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  EXPECT_EQ(decode(bytes, 8).fault, "");
}

TEST(ImageFile, AnyTruncationIsFoundBeforeDecoding) {
  for (const char* extension : {".png", ".jpg", ".tiff"}) {
    const std::string whole = encoded(small_picture(CV_8UC3), extension);
    ASSERT_TRUE(decode(whole, 8).good());
    for (std::size_t kept = 0; kept < whole.size(); kept += 7) {
      const DecodedImage cut = decode(whole.substr(0, kept), 8);
      EXPECT_FALSE(cut.good()) << extension << " cut to " << kept << " of " << whole.size();
      EXPECT_TRUE(cut.pixels.empty());
      if (kept > 64) {
        EXPECT_TRUE(cut.quality.has(Quality::frame_truncated))
            << extension << " " << kept << " " << cut.fault;
      }
    }
  }
  EXPECT_EQ(decode(encoded(small_picture(CV_8UC1), ".png").substr(0, 150), 8).fault,
            "a.png: the file ends before the picture does");
  EXPECT_EQ(decode("", 8).fault, "a.png: expected a picture, the file is empty");
}

TEST(ImageFile, WrongSizeDepthAndChannelsAreFlagged) {
  const DecodedImage size = decode(encoded(cv::Mat(40, 60, CV_8UC1, cv::Scalar(1)), ".png"), 8);
  EXPECT_TRUE(size.quality.has(Quality::frame_wrong_size));
  EXPECT_EQ(size.fault, "a.png: expected 64x48 pixels, got 60x40 pixels");
  const DecodedImage depth = decode(encoded(small_picture(CV_16UC1), ".png"), 8);
  EXPECT_TRUE(depth.quality.has(Quality::frame_wrong_depth));
  EXPECT_EQ(depth.fault, "a.png: expected 8 bits a sample for a camera of 8 bits, got 16");
  EXPECT_EQ(decode(encoded(small_picture(CV_8UC1), ".png"), 12).fault,
            "a.png: expected 16 bits a sample for a camera of 12 bits, got 8");
  const DecodedImage alpha = decode(encoded(cv::Mat(48, 64, CV_8UC4, cv::Scalar(1, 2, 3, 4)), ".png"), 8);
  EXPECT_TRUE(alpha.quality.has(Quality::frame_wrong_depth));
  EXPECT_EQ(alpha.fault, "a.png: expected 1 channel (mono) or 3 (RGB), got 4");
  const DecodedImage above = decode(encoded(cv::Mat(48, 64, CV_16UC1, cv::Scalar(4096)), ".png"), 12);
  EXPECT_TRUE(above.quality.has(Quality::frame_wrong_depth));
  EXPECT_EQ(above.fault, "a.png: expected digital numbers below 4096, got 4096");
}

TEST(ImageFile, ADecompressionBombIsNotDecoded) {
  // 40 kB that would be 400 million pixels.
  std::string bomb = encoded(cv::Mat(48, 64, CV_8UC1, cv::Scalar(0)), ".png");
  for (const int at : {16, 20}) bomb.replace(static_cast<std::size_t>(at), 4, std::string("\0\0\x4E\x20", 4));
  const DecodedImage refused = decode(bomb, 8);
  EXPECT_TRUE(refused.quality.has(Quality::frame_too_large));
  EXPECT_EQ(refused.fault, "a.png: expected 64x48 pixels, the header claims 20000x20000 pixels; not decoded");
  const DecodedImage fat = decode(std::string(2'000'000, 'x'), 8);
  EXPECT_TRUE(fat.quality.has(Quality::frame_too_large));
  EXPECT_EQ(fat.fault, "a.png: expected at most 548864 bytes for such a camera, got 2000000");
}

// A grey TIFF of 64 x 48 with these tags besides.
std::string tiff_with(std::map<std::uint32_t, std::uint32_t> tags) {
  tags.merge(std::map<std::uint32_t, std::uint32_t>{
      {256, 64}, {257, 48}, {258, 8}, {259, 1}, {262, 1}, {273, 0}, {277, 1}, {278, 48}, {279, 64 * 48}});
  tags[273] = static_cast<std::uint32_t>(8 + 2 + 12 * tags.size() + 4);  // the pixels stand behind all
  std::string file;
  const auto put = [&file](std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) file += static_cast<char>(value >> (8 * i));
  };
  file = "II*";
  put(0, 1);
  put(8, 4);
  put(static_cast<std::uint32_t>(tags.size()), 2);
  for (const auto& [tag, value] : tags) {
    put(tag, 2);
    put(4, 2);
    put(1, 4);
    put(value, 4);
  }
  put(0, 4);
  return file + std::string(std::size_t{64} * 48, 'x');
}

// A fuzzer found that libtiff takes RowsPerStrip for the side of a tile that is not told: 2 GB for 314 bytes.
TEST(ImageFile, ATileOfWhichOneSideIsNotToldIsNotDecoded) {
  EXPECT_EQ(decode(tiff_with({}), 8).fault, "");
  for (const auto& tags :
       {std::map<std::uint32_t, std::uint32_t>{{278, 16'384}, {322, 65'535}}, {{323, 65'535}}}) {
    EXPECT_FALSE(read_image_header(bytes_of(tiff_with(tags)))->complete);
    EXPECT_NE(decode(tiff_with(tags), 8).fault, "");
  }
}

TEST(ImageFile, WhatIsNoPictureIsUndecodable) {
  EXPECT_EQ(decode("GIF89a and more", 8).fault, "a.png: expected a PNG, JPEG or TIFF picture");
  std::string damaged = encoded(small_picture(CV_8UC1), ".png");
  for (std::size_t i = 60; i < 90; ++i) damaged[i] = static_cast<char>(damaged[i] ^ 0x5A);
  const DecodedImage image = decode(damaged, 8);
  EXPECT_TRUE(image.quality.has(Quality::frame_undecodable));
  EXPECT_EQ(image.fault, "a.png: the picture's data are damaged");
}

// Bytes changed at random never crash the reader, and never yield a picture of another size.
TEST(ImageFile, SurvivesRandomDamage) {
  std::mt19937 random(20261122);
  for (const char* extension : {".png", ".jpg", ".tiff"}) {
    const std::string whole = encoded(small_picture(CV_8UC3), extension);
    for (int round = 0; round < 300; ++round) {
      std::string damaged = whole;
      for (int i = 0; i < 4; ++i)
        damaged[random() % std::min<std::size_t>(damaged.size(), 400)] = static_cast<char>(random());
      const DecodedImage image = decode(damaged, 8);
      EXPECT_EQ(image.good(), image.quality.empty());
      if (image.good()) {
        EXPECT_EQ(image.pixels.pixels.size(), 64U * 48U);
      }
    }
  }
}

TEST(ImageFile, TellsWhyAFileCannotBeRead) {
  const TemporaryFolder folder;
  folder.write("images/a.png", encoded(small_picture(CV_8UC1), ".png"));
  EXPECT_EQ(load_image(folder.path(), "images/a.png", camera(8)).fault, "");
  const DecodedImage missing = load_image(folder.path(), "images/b.png", camera(8));
  EXPECT_TRUE(missing.quality.has(Quality::frame_missing));
  EXPECT_EQ(missing.fault, "images/b.png: No such file or directory");
  ASSERT_EQ(::mkfifo((folder.path() / "fifo").c_str(), 0600), 0);
  EXPECT_EQ(load_image(folder.path(), "fifo", camera(8)).fault, "fifo: expected a regular file");
  std::filesystem::create_symlink("images", folder.path() / "link");
  EXPECT_EQ(load_image(folder.path(), "link/a.png", camera(8)).fault,
            "link/a.png: expected no symbolic link in the path");
}

TEST(ImageFile, APlainPictureIsTakenAsItIs) {
  const TemporaryFolder folder;
  const auto file = folder.write("a.png", encoded(small_picture(CV_16UC1), ".png"));
  const PlainImage image = load_plain_image(file);
  EXPECT_EQ(image.pixels.width_px, 64);
  EXPECT_EQ(image.bit_depth, 16);
  const auto complaint = test::complaint_of([&] { load_plain_image(file, 1000); });
  EXPECT_EQ(complaint.exit_code, kExitData);
  EXPECT_THAT(complaint.text,
              testing::EndsWith("a.png: expected at most 1000 pixels, the header claims 64x48"));
}

}  // namespace
}  // namespace lampglow::daemon
