#include "estimator/photometry/targets.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace lampglow::photometry {
namespace {

double median(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

bool is_picture(const RadianceImage& image, int x, int y) {
  return (image.mask.at(x, y) & (kHot | kInvalid)) == 0;
}

// Every pixel's median over the frames, each frame divided by the median of its upper third.
Image<float> median_frame(std::span<const RadianceImage> frames) {
  std::vector<double> level;
  for (const RadianceImage& frame : frames) {
    std::vector<double> upper(
        frame.radiance.pixels.begin(),
        frame.radiance.pixels.begin() + static_cast<std::ptrdiff_t>(frame.radiance.pixels.size() / 3));
    level.push_back(std::max(median(upper), 1e-9));
  }
  Image<float> result(frames[0].radiance.width_px, frames[0].radiance.height_px);
  std::vector<double> values(frames.size());
  for (size_t i = 0; i < result.pixels.size(); ++i) {
    for (size_t f = 0; f < frames.size(); ++f) values[f] = frames[f].radiance.pixels[i] / level[f];
    result.pixels[i] = static_cast<float>(median(values));
  }
  return result;
}

// From the top of each column down to where it gets darker than 0.6 of the sky so far, for 6 rows together: a
// fly on the window is smaller, a cloud's shade weaker.
std::vector<int> find_skyline(const Image<float>& picture) {
  constexpr int kRun_px = 6;
  constexpr double kDarker = 0.6, kFollow = 0.05;
  const int first = picture.height_px / 25;  // an overlay of text stands there
  std::vector<int> rows(static_cast<size_t>(picture.width_px), -1);
  for (int x = 0; x < picture.width_px; ++x) {
    std::vector<double> top;
    for (int y = first; y < first + 15 && y < picture.height_px; ++y) top.push_back(picture.at(x, y));
    if (top.empty()) continue;
    double sky = median(top);
    for (int y = first + 15; y + kRun_px < picture.height_px; ++y) {
      std::vector<double> run;
      run.reserve(kRun_px);
      for (int j = 0; j < kRun_px; ++j) run.push_back(picture.at(x, y + j));
      if (median(run) < kDarker * sky) {
        rows[static_cast<size_t>(x)] = y;
        break;
      }
      sky += kFollow * (picture.at(x, y) - sky);
    }
  }
  return rows;
}

// A band over the whole width that ends just above the higher parts of the skyline.
bool find_sky_box(const std::vector<int>& skyline, const Image<float>& picture, DayCalibration& day) {
  std::vector<int> rows;
  for (const int row : skyline)
    if (row >= 0) rows.push_back(row);
  if (rows.size() * 4 < skyline.size()) return false;
  std::sort(rows.begin(), rows.end());
  const int bottom = rows[rows.size() / 10] - 8,
            top = std::max(bottom - picture.height_px / 9, picture.height_px / 25);
  if (bottom - top < 8) return false;
  day.sky_x_px = 4;
  day.sky_y_px = top;
  day.sky_width_px = picture.width_px - 8;
  day.sky_height_px = bottom - top;
  return true;
}

struct Energy {
  double gradient = 0, noise = 0;
};

Energy energy_of(const RadianceImage& image, int left, int top, int side) {
  Energy e;
  int n = 0;
  for (int y = std::max(top, 1); y < std::min(top + side, image.radiance.height_px - 1); ++y)
    for (int x = std::max(left, 1); x < std::min(left + side, image.radiance.width_px - 1); ++x) {
      if (!is_picture(image, x, y)) continue;
      const double gx = 0.5 * (image.radiance.at(x + 1, y) - image.radiance.at(x - 1, y));
      const double gy = 0.5 * (image.radiance.at(x, y + 1) - image.radiance.at(x, y - 1));
      e.gradient += gx * gx + gy * gy;
      if (std::isfinite(image.variance.at(x, y))) e.noise += image.variance.at(x, y);
      ++n;
    }
  return n > 0 ? Energy{e.gradient / n, e.noise / n} : Energy{};
}

double skyline_part(const std::vector<int>& skyline, int left, int top, int side) {
  int inside = 0;
  for (int x = left; x < left + side; ++x) {
    const int row = skyline[static_cast<size_t>(x)];
    inside += row >= top && row < top + side;
  }
  return static_cast<double>(inside) / side;
}

// Nearly all of it above the skyline: what shows there is clouds, a dirty window or the picture's edge.
bool sky_alone(const std::vector<int>& skyline, int left, int top, int side) {
  int not_sky = 0;
  for (int x = left; x < left + side; ++x) {
    const int row = skyline[static_cast<size_t>(x)];
    not_sky += row < 0 || row < top + side;
  }
  return not_sky < 0.1 * side;
}

}  // namespace

DaySurvey survey_day(std::span<const RadianceImage> clear, const DaySurveyOptions& options) {
  DaySurvey survey;
  if (clear.empty()) return survey;
  for (const RadianceImage& frame : clear)
    if (frame.radiance.width_px != clear[0].radiance.width_px ||
        frame.radiance.height_px != clear[0].radiance.height_px)
      throw std::invalid_argument("survey_day: the frames differ in size");
  const Image<float> picture = median_frame(clear);
  survey.skyline_px = find_skyline(picture);
  if (!find_sky_box(survey.skyline_px, picture, survey.day)) return survey;

  struct Candidate {
    Target target;
    bool skyline;
    double snr;
  };
  std::vector<Candidate> found;
  const int side = std::max(picture.width_px / options.cells_across, 8);
  const int first = picture.height_px / 36;  // below an overlay of text
  for (int row = 0; first + (row + 1) * side <= picture.height_px; ++row)
    for (int column = 0; (column + 1) * side <= picture.width_px; ++column) {
      const int x = column * side, y = first + row * side;
      if (sky_alone(survey.skyline_px, x, y, side)) continue;
      std::vector<double> snr;
      for (const RadianceImage& frame : clear) {
        const Energy e = energy_of(frame, x, y, side);
        snr.push_back(e.gradient / std::max(e.noise, 1e-30));
      }
      const double typical = median(snr);
      if (typical < options.least_snr) continue;
      Target target;
      target.id = "day-" + std::to_string(row) + "-" + std::to_string(column);
      target.x_px = x, target.y_px = y, target.width_px = side, target.height_px = side;
      found.push_back({target, skyline_part(survey.skyline_px, x, y, side) > options.edge_part, typical});
    }
  if (found.size() > static_cast<size_t>(options.most_targets)) {
    std::vector<double> order;
    order.reserve(found.size());
    for (const Candidate& c : found) order.push_back(c.snr);
    std::sort(order.rbegin(), order.rend());
    const double least = order[static_cast<size_t>(options.most_targets)];
    std::erase_if(found, [&](const Candidate& c) { return c.snr <= least; });
  }
  for (const Candidate& c : found) survey.targets.push_back(c.target), survey.skyline.push_back(c.skyline);
  return survey;
}

}  // namespace lampglow::photometry
