// A tiny archive on disk, made by the test that needs it: a dark sky with one bright spot.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace lampglow::test {

// A camera of 64x48 pixels. `more` are lines of further tables.
inline std::string small_site(int bit_depth, const std::string& more = "") {
  return "[site]\nname = \"small\"\nlatitude_deg = 52.0\nlongitude_deg = 5.0\n\n[camera]\nwidth_px = 64\n"
         "height_px = 48\nfocal_length_px = 100.0\nbit_depth = " +
         std::to_string(bit_depth) +
         "\nblack_level_dn = 0.0\nsaturation_dn = " + std::to_string((1 << bit_depth) - 1) +
         ".0\nresponse = \"linear\"\n\n[[light]]\nid = \"L1\"\nx_px = 32.5\ny_px = 24.5\ndistance_m = "
         "100.0\n" +
         more;
}

// Pixel (column, row) holds 10 * row + column, so that a swapped or scaled picture shows; the spot is
// brighter.
inline cv::Mat small_picture(int type) {
  cv::Mat picture(48, 64, type);
  for (int row = 0; row < picture.rows; ++row)
    for (int column = 0; column < picture.cols; ++column) {
      const double value = row * 2 + column;
      if (type == CV_8UC1) picture.at<std::uint8_t>(row, column) = static_cast<std::uint8_t>(value);
      if (type == CV_16UC1) picture.at<std::uint16_t>(row, column) = static_cast<std::uint16_t>(value * 16);
      if (type == CV_8UC3)  // blue, green, red
        picture.at<cv::Vec3b>(row, column) = cv::Vec3b(1, static_cast<std::uint8_t>(value), 200);
    }
  return picture;
}

inline std::string encoded(const cv::Mat& picture, const std::string& extension,
                           const std::vector<int>& parameters = {}) {
  std::vector<unsigned char> bytes;
  cv::imencode(extension, picture, bytes, parameters);
  return {bytes.begin(), bytes.end()};
}

inline constexpr const char* kFramesHeader = "time_utc,file,exposure_s,gain_db,role,reference_mor_m\n";

}  // namespace lampglow::test
