#include "daemon/annotate.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/imgproc.hpp>

#include "daemon/pictures/jpeg.h"

namespace lampglow::daemon {
namespace {

struct Colour {
  int red, green, blue;
};

Colour colour_of(LampState state) {
  switch (state) {
    case LampState::seen:
      return {63, 185, 80};
    case LampState::faded:
      return {227, 179, 65};
    case LampState::off:
      return {139, 148, 158};
    case LampState::hidden:
      return {163, 113, 247};
    case LampState::saturated:
      return {247, 129, 102};
    case LampState::unknown:
      break;
  }
  return {121, 192, 255};
}

cv::Scalar rgb(Colour c) {
  return {static_cast<double>(c.red), static_cast<double>(c.green), static_cast<double>(c.blue)};
}

double percentile_dn(const Image<std::uint16_t>& pixels, double share) {
  std::vector<std::size_t> counts(65536);
  for (const std::uint16_t dn : pixels.pixels) ++counts[dn];
  const auto wanted = static_cast<std::size_t>(share * static_cast<double>(pixels.pixels.size()));
  std::size_t below = 0;
  for (std::size_t dn = 0; dn < counts.size(); ++dn)
    if ((below += counts[dn]) > wanted) return static_cast<double>(dn);
  return 65535;
}

// 8-bit grey for the eye, at most max_width_px wide.
cv::Mat stretched(const Image<std::uint16_t>& pixels, const Camera& camera, const JpegOptions& options,
                  double& scale) {
  const double black = camera.black_level_dn;
  const double white =
      std::clamp(percentile_dn(pixels, 0.999), black + 16, std::max(camera.saturation_dn, black + 16));
  const double gamma = camera.response.kind == Response::Kind::linear ? 1 / 2.2 : 1.0;
  std::vector<std::uint8_t> table(65536);
  for (std::size_t dn = 0; dn < table.size(); ++dn) {
    const double share = std::clamp((static_cast<double>(dn) - black) / (white - black), 0.0, 1.0);
    table[dn] = static_cast<std::uint8_t>(std::lround(255 * std::pow(share, gamma)));
  }
  cv::Mat grey(pixels.height_px, pixels.width_px, CV_8UC1);
  for (int row = 0; row < grey.rows; ++row)
    for (int column = 0; column < grey.cols; ++column)
      grey.at<std::uint8_t>(row, column) = table[pixels.at(column, row)];
  scale = std::min(1.0, static_cast<double>(options.max_width_px) / pixels.width_px);
  if (scale < 1) cv::resize(grey, grey, {}, scale, scale, cv::INTER_AREA);
  return grey;
}

// Grey, or red, green, blue.
std::vector<std::uint8_t> to_jpeg(const cv::Mat& picture, const JpegOptions& options) {
  const std::span<const std::uint8_t> samples(picture.data, picture.total() * picture.elemSize());
  return encode_jpeg({{picture.cols, picture.rows, picture.channels(), 8}, samples}, options.jpeg_quality);
}

// With a dark rim, readable on any ground. An eighth of a pixel is OpenCV's finest step with shift 3.
void draw_lamp(cv::Mat& picture, const LampFit& lamp, double scale) {
  constexpr int kShift = 3;
  // Site files put pixel centres at .5, OpenCV puts them at whole numbers.
  const auto fixed = [scale](double px) {
    return static_cast<int>(std::lround((px * scale - 0.5) * (1 << kShift)));
  };
  const cv::Point centre(fixed(lamp.x_px), fixed(lamp.y_px));
  const int radius = 9 << kShift;
  const cv::Scalar colour = rgb(colour_of(lamp.state)), dark(0, 0, 0);
  cv::circle(picture, centre, radius, dark, 3, cv::LINE_AA, kShift);
  cv::circle(picture, centre, radius, colour, 1, cv::LINE_AA, kShift);
  const cv::Point text((centre.x >> kShift) + 11, (centre.y >> kShift) - 6);
  // Colour alone does not tell everyone: what is not plainly seen is named.
  const std::string label =
      lamp.state == LampState::seen ? lamp.id : lamp.id + " " + std::string(to_string(lamp.state));
  cv::putText(picture, label, text, cv::FONT_HERSHEY_SIMPLEX, 0.4, dark, 3, cv::LINE_AA);
  cv::putText(picture, label, text, cv::FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv::LINE_AA);
}

void draw_target(cv::Mat& picture, const Target& target, double scale) {
  const auto whole = [scale](double px) { return static_cast<int>(std::lround(px * scale)); };
  const cv::Rect box(whole(target.x_px), whole(target.y_px), whole(target.width_px), whole(target.height_px));
  const cv::Scalar colour(121, 192, 255), dark(0, 0, 0);
  cv::rectangle(picture, box, dark, 3, cv::LINE_AA);
  cv::rectangle(picture, box, colour, 1, cv::LINE_AA);
  cv::putText(picture, target.id, {box.x + 3, box.y + 13}, cv::FONT_HERSHEY_SIMPLEX, 0.4, dark, 3,
              cv::LINE_AA);
  cv::putText(picture, target.id, {box.x + 3, box.y + 13}, cv::FONT_HERSHEY_SIMPLEX, 0.4, colour, 1,
              cv::LINE_AA);
}

}  // namespace

const Exposure* exposure_to_show(const Bracket& bracket, const Camera& camera) {
  const Exposure* best = nullptr;
  double best_mean = 0;
  const Exposure* darkest = nullptr;
  double darkest_mean = 0;
  for (const Exposure& exposure : bracket.exposures) {
    double sum = 0;
    std::size_t saturated = 0;
    for (const std::uint16_t dn : exposure.pixels.pixels) {
      sum += dn;
      saturated += dn >= camera.saturation_dn;
    }
    if (exposure.pixels.empty()) continue;
    const double mean = sum / static_cast<double>(exposure.pixels.pixels.size());
    if (!darkest || mean < darkest_mean) {
      darkest = &exposure;
      darkest_mean = mean;
    }
    if (saturated * 100 <= exposure.pixels.pixels.size() && (!best || mean > best_mean)) {
      best = &exposure;
      best_mean = mean;
    }
  }
  return best ? best : darkest;
}

std::vector<std::uint8_t> plain_jpeg(const Image<std::uint16_t>& pixels, const Camera& camera,
                                     const JpegOptions& options) {
  double scale = 1;
  return to_jpeg(stretched(pixels, camera, options, scale), options);
}

std::vector<std::uint8_t> annotated_jpeg(const Image<std::uint16_t>& pixels, const Camera& camera,
                                         std::span<const LampFit> lamps, std::span<const Target> targets,
                                         const JpegOptions& options) {
  double scale = 1;
  cv::Mat picture;
  cv::cvtColor(stretched(pixels, camera, options, scale), picture, cv::COLOR_GRAY2RGB);
  for (const Target& target : targets) draw_target(picture, target, scale);
  for (const LampFit& lamp : lamps) draw_lamp(picture, lamp, scale);
  return to_jpeg(picture, options);
}

std::string state_colour(LampState state) {
  const Colour c = colour_of(state);
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", static_cast<unsigned>(c.red),
                static_cast<unsigned>(c.green), static_cast<unsigned>(c.blue));
  return text;
}

}  // namespace lampglow::daemon
