#include "daemon/commands/annotate.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "daemon/config/files.h"
#include "daemon/pictures/png.h"

namespace lampglow::daemon {
namespace {

cv::Scalar colour_of(Mark::Colour colour) {
  switch (colour) {
    case Mark::Colour::lamp:
      return {80, 220, 80};  // red, green, blue
    case Mark::Colour::moving:
      return {255, 60, 60};
    case Mark::Colour::target:
      return {60, 180, 255};
  }
  return {};
}

// Grey picture, stretched: the median becomes dark grey, the brightest white.
cv::Mat stretched(const Image<std::uint16_t>& picture) {
  Pixels<std::uint16_t> sorted = picture.pixels;
  const auto at = [&](double part) {
    const auto place = static_cast<std::ptrdiff_t>(part * static_cast<double>(sorted.size() - 1));
    std::nth_element(sorted.begin(), sorted.begin() + place, sorted.end());
    return static_cast<double>(sorted[static_cast<size_t>(place)]);
  };
  const double low = at(0.01), middle = at(0.5), high = at(1.0);
  const double scale = std::max({2 * (middle - low), 0.02 * (high - low), 1.0});
  const double top = std::asinh((high - low) / scale);
  cv::Mat grey(picture.height_px, picture.width_px, CV_8U);
  for (int y = 0; y < picture.height_px; ++y)
    for (int x = 0; x < picture.width_px; ++x)
      grey.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(
          255 * std::asinh(std::max(0.0, picture.at(x, y) - low) / scale) / std::max(top, 1e-9));
  return grey;
}

void draw(cv::Mat& canvas, const Mark& mark, double zoom) {
  const auto point = [zoom](double x, double y) {
    return cv::Point(static_cast<int>(std::lround(x * zoom)), static_cast<int>(std::lround(y * zoom)));
  };
  const cv::Scalar colour = colour_of(mark.colour);
  cv::Point text = point(mark.x_px + 0.8 * mark.radius_px, mark.y_px - 0.8 * mark.radius_px);
  if (mark.width_px > 0 && mark.height_px > 0) {
    cv::rectangle(canvas, point(mark.x_px, mark.y_px),
                  point(mark.x_px + mark.width_px, mark.y_px + mark.height_px), colour, 1, cv::LINE_AA);
    text = point(mark.x_px, mark.y_px) + cv::Point(3, -4);
  } else {
    cv::circle(canvas, point(mark.x_px, mark.y_px), static_cast<int>(std::lround(mark.radius_px * zoom)),
               colour, 1, cv::LINE_AA);
  }
  cv::putText(canvas, mark.label, text, cv::FONT_HERSHEY_SIMPLEX, 0.45, cv::Scalar(0, 0, 0), 3, cv::LINE_AA);
  cv::putText(canvas, mark.label, text, cv::FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv::LINE_AA);
}

}  // namespace

void write_annotated(const std::filesystem::path& path, const Image<std::uint16_t>& picture,
                     std::span<const Mark> marks) {
  const double zoom = picture.width_px < 900 ? 2 : 1;
  cv::Mat canvas;
  cv::resize(stretched(picture), canvas, {}, zoom, zoom, cv::INTER_NEAREST);
  cv::cvtColor(canvas, canvas, cv::COLOR_GRAY2RGB);
  for (const Mark& mark : marks) draw(canvas, mark, zoom);
  const std::span<const std::uint8_t> samples(canvas.data, canvas.total() * canvas.elemSize());
  const Bytes png = encode_png({{canvas.cols, canvas.rows, canvas.channels(), 8}, samples});
  write_file_atomically(path, {reinterpret_cast<const char*>(png.data()), png.size()});
}

}  // namespace lampglow::daemon
