// A simulated night as a camera of more pixels would have taken it.
#pragma once

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tests/support/temporary_folder.h"

namespace lampglow::test {

using Enlarger = std::function<cv::Mat(const cv::Mat& picture, cv::Size size)>;

inline cv::Mat stretched(const cv::Mat& picture, cv::Size size) {
  cv::Mat large;
  cv::resize(picture, large, size, 0, 0, cv::INTER_CUBIC);
  return large;
}

// `text`, a simulated site file, with everything that is counted in pixels at the new size. The simulated
// axis is the picture's middle.
inline std::string enlarged_site(const std::string& text, cv::Size size) {
  std::istringstream lines(text);
  std::ostringstream enlarged;
  double scale_x = 1, scale_y = 1;
  for (std::string line; std::getline(lines, line);) {
    const std::string key = line.substr(0, line.find(' '));
    const auto value = [&] { return std::stod(line.substr(line.find('=') + 1)); };
    const auto tenths = [](double number) { return std::round(number * 10) / 10; };
    if (key == "width_px") scale_x = size.width / value();
    if (key == "height_px") scale_y = size.height / value();
    if (key == "width_px")
      enlarged << key << " = " << size.width << "\n";
    else if (key == "height_px")
      enlarged << key << " = " << size.height << "\n";
    else if (key == "focal_length_px" || key == "x_px")
      enlarged << key << " = " << tenths(value() * scale_x) << "\n";
    else if (key == "y_px")
      enlarged << key << " = " << tenths(value() * scale_y) << "\n";
    else if (key == "principal_point_px")
      enlarged << key << " = [" << size.width / 2.0 << ", " << size.height / 2.0 << "]\n";
    else
      enlarged << line << "\n";
  }
  return enlarged.str();
}

// Writes the archive `from` to `to` with pictures of `size`. Throws std::runtime_error.
inline void enlarge_archive(const std::filesystem::path& from, const std::filesystem::path& to, cv::Size size,
                            const Enlarger& enlarge = stretched) {
  std::filesystem::create_directories(to / "images");
  for (const auto& entry : std::filesystem::directory_iterator(from / "images")) {
    const cv::Mat picture = cv::imread(entry.path().string(), cv::IMREAD_UNCHANGED);
    const std::filesystem::path file = to / "images" / entry.path().filename();
    // As simulate writes them: PNG at its least compression.
    if (picture.empty() ||
        !cv::imwrite(file.string(), enlarge(picture, size), {cv::IMWRITE_PNG_COMPRESSION, 1}))
      throw std::runtime_error("cannot make " + file.string());
  }
  for (const char* table : {"frames.csv", "truth.csv"}) std::filesystem::copy_file(from / table, to / table);
  std::ofstream(to / "site.toml") << enlarged_site(read_all(from / "site.toml"), size);
}

}  // namespace lampglow::test
