#include "daemon/station/picture.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

namespace lampglow::daemon {
namespace {

const Exposure* longest(const Bracket& bracket) {
  const Exposure* found = nullptr;
  for (const Exposure& exposure : bracket.exposures)
    if (!exposure.pixels.empty() &&
        (!found || exposure.exposure_s.value_or(0) > found->exposure_s.value_or(0)))
      found = &exposure;
  return found;
}

// A table from DN to grey: black below the 1st percentile, white at the brightest, asinh between.
std::vector<std::uint8_t> stretch_table(const Image<std::uint16_t>& picture) {
  std::vector<std::uint32_t> histogram(65536);
  for (const std::uint16_t dn : picture.pixels) ++histogram[dn];
  const auto percentile = [&](double part) {
    double sum = 0;
    const double wanted = part * static_cast<double>(picture.pixels.size());
    for (size_t dn = 0; dn < histogram.size(); ++dn)
      if ((sum += histogram[dn]) >= wanted) return static_cast<double>(dn);
    return 65535.0;
  };
  const double low = percentile(0.01), middle = percentile(0.5), high = percentile(1.0);
  const double scale = std::max({2 * (middle - low), 0.02 * (high - low), 1.0});
  const double top = std::max(std::asinh((high - low) / scale), 1e-9);
  std::vector<std::uint8_t> table(65536);
  for (size_t dn = 0; dn < table.size(); ++dn)
    table[dn] = cv::saturate_cast<std::uint8_t>(
        255 * std::asinh(std::max(0.0, static_cast<double>(dn) - low) / scale) / top);
  return table;
}

cv::Mat stretched(const Image<std::uint16_t>& picture) {
  const std::vector<std::uint8_t> table = stretch_table(picture);
  cv::Mat grey(picture.height_px, picture.width_px, CV_8U);
  for (int y = 0; y < picture.height_px; ++y)
    for (int x = 0; x < picture.width_px; ++x) grey.at<std::uint8_t>(y, x) = table[picture.at(x, y)];
  return grey;
}

cv::Scalar colour_of(LampState state) {  // blue, green, red
  switch (state) {
    case LampState::seen:
      return {90, 220, 90};
    case LampState::faded:
      return {60, 200, 240};
    case LampState::saturated:
      return {240, 160, 60};
    case LampState::off:
    case LampState::hidden:
      return {80, 80, 255};
    case LampState::unknown:
      break;
  }
  return {180, 180, 180};
}

void draw(cv::Mat& canvas, const LampFit& lamp) {
  const cv::Point centre(cvRound(lamp.x_px - 0.5), cvRound(lamp.y_px - 0.5));
  const int radius = std::max(8, canvas.cols / 80);
  const double scale = std::max(0.4, canvas.cols / 1800.0);
  cv::circle(canvas, centre, radius, colour_of(lamp.state), std::max(1, canvas.cols / 900), cv::LINE_AA);
  const std::string label = lamp.id + " " + std::string(to_string(lamp.state));
  cv::putText(canvas, label, centre + cv::Point(radius, -radius), cv::FONT_HERSHEY_SIMPLEX, scale,
              colour_of(lamp.state), 1, cv::LINE_AA);
}

std::shared_ptr<const std::string> jpeg(const cv::Mat& picture, int quality) {
  std::vector<unsigned char> bytes;
  if (!cv::imencode(".jpg", picture, bytes, {cv::IMWRITE_JPEG_QUALITY, quality})) return nullptr;
  return std::make_shared<const std::string>(bytes.begin(), bytes.end());
}

}  // namespace

Pictures render_pictures(const Bracket& bracket, const FrameResult& result, int jpeg_quality) {
  const Exposure* exposure = longest(bracket);
  if (!exposure) return {};
  const cv::Mat grey = stretched(exposure->pixels);
  cv::Mat colour;
  cv::cvtColor(grey, colour, cv::COLOR_GRAY2BGR);
  for (const LampFit& lamp : result.lamps) draw(colour, lamp);
  return {jpeg(grey, jpeg_quality), jpeg(colour, jpeg_quality)};
}

}  // namespace lampglow::daemon
