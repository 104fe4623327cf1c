#include "estimator/photometry/response_measurement.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/photo.hpp>
#include <stdexcept>

namespace lampglow::photometry {
namespace {

constexpr int kLevels = 256;
constexpr int kLowest = 3, kHighest = 250;  // levels in between are trusted

// The exposures in order of their time, shortest first.
std::vector<const Exposure*> ordered(std::span<const Exposure> exposures) {
  std::vector<const Exposure*> sorted;
  for (const Exposure& exposure : exposures) {
    if (!exposure.exposure_s || !(*exposure.exposure_s > 0))
      throw std::invalid_argument(exposure.name + ": exposure time expected, none is known");
    if (exposure.pixels.width_px != exposures[0].pixels.width_px ||
        exposure.pixels.height_px != exposures[0].pixels.height_px)
      throw std::invalid_argument(exposure.name + ": expected the size of " + exposures[0].name);
    sorted.push_back(&exposure);
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const Exposure* a, const Exposure* b) { return *a->exposure_s < *b->exposure_s; });
  if (sorted.size() < 2 || !(*sorted.back()->exposure_s > 1.2 * *sorted.front()->exposure_s))
    throw std::invalid_argument(
        "expected at least two exposures of different time (by a factor 1.2 or more)");
  return sorted;
}

// One place: the level of each exposure there, the mean of 3x3 pixels.
struct Place {
  std::vector<double> level;
};

// Empty if the place is not flat, or the exposures are out of order there (something moved).
std::vector<double> levels_at(const std::vector<const Exposure*>& exposures, int column, int row,
                              double per_level) {
  std::vector<double> levels;
  for (const Exposure* exposure : exposures) {
    double sum = 0, lowest = 1e9, highest = 0;
    for (int dy = -1; dy <= 1; ++dy) {
      for (int dx = -1; dx <= 1; ++dx) {
        const double level = exposure->pixels.at(column + dx, row + dy) / per_level;
        sum += level / 9;
        lowest = std::min(lowest, level), highest = std::max(highest, level);
      }
    }
    if (highest - lowest > 12 + 0.1 * sum) return {};
    if (!levels.empty() && sum < levels.back() - 1.5) return {};
    levels.push_back(sum);
  }
  return levels;
}

// Up to `most` places, as many from each step of brightness (in the middle exposure) as can be had.
std::vector<Place> choose_places(const std::vector<const Exposure*>& exposures, double per_level,
                                 size_t most) {
  constexpr size_t kSteps = 32;
  std::vector<std::vector<Place>> by_step(kSteps);
  const auto& pixels = exposures.front()->pixels;
  const int step = std::max(1, static_cast<int>(std::sqrt(pixels.width_px * pixels.height_px / 400000.0)));
  for (int row = 1; row + 1 < pixels.height_px; row += step) {
    for (int column = 1; column + 1 < pixels.width_px; column += step) {
      std::vector<double> levels = levels_at(exposures, column, row, per_level);
      if (levels.empty()) continue;
      const auto useful =
          std::count_if(levels.begin(), levels.end(), [](double v) { return v > kLowest && v < kHighest; });
      if (useful < 2) continue;
      const auto place = static_cast<size_t>(levels[levels.size() / 2] / kLevels * kSteps);
      by_step[std::min(place, kSteps - 1)].push_back({std::move(levels)});
    }
  }
  std::vector<Place> chosen;
  for (const auto& places : by_step) {
    const size_t take = std::min(places.size(), most / kSteps);
    for (size_t i = 0; i < take; ++i) chosen.push_back(places[i * places.size() / take]);
  }
  return chosen;
}

// The places of one exposure as a square picture, the last place repeated to fill it.
cv::Mat packed(const std::vector<Place>& places, size_t exposure, int side) {
  cv::Mat picture(side, side, CV_8U);
  for (int i = 0; i < side * side; ++i) {
    const Place& place = places[std::min(static_cast<size_t>(i), places.size() - 1)];
    picture.at<std::uint8_t>(i / side, i % side) = cv::saturate_cast<std::uint8_t>(place.level[exposure]);
  }
  return picture;
}

std::vector<double> solve(const std::vector<Place>& places, const std::vector<const Exposure*>& exposures,
                          ResponseMethod method) {
  const int side = static_cast<int>(std::ceil(std::sqrt(static_cast<double>(places.size()))));
  std::vector<cv::Mat> pictures;
  std::vector<float> times;
  for (size_t i = 0; i < exposures.size(); ++i) {
    cv::Mat picture = packed(places, i, side);
    // OpenCV 4.6's Robertson writes three channels whatever it is given (calibrate.cpp, `card`).
    if (method == ResponseMethod::robertson) cv::cvtColor(picture, picture, cv::COLOR_GRAY2BGR);
    pictures.push_back(picture);
    times.push_back(static_cast<float>(*exposures[i]->exposure_s));
  }
  cv::Mat response;
  if (method == ResponseMethod::debevec)
    cv::createCalibrateDebevec(side * side, 10.0F, false)->process(pictures, response, times);
  else
    cv::createCalibrateRobertson(100, 1e-4F)->process(pictures, response, times);
  std::vector<double> levels(kLevels);
  for (int i = 0; i < kLevels; ++i) levels[static_cast<size_t>(i)] = response.ptr<float>(i)[0];
  return levels;
}

// The ends hold few samples or clipped ones: below and above the trusted levels the curve goes on as the
// power law that its neighbourhood follows. Then it never falls, starts at 0 and ends at 1.
void tidy(std::vector<double>& levels) {
  const auto slope_at = [&](int from, int to) {
    return std::log(levels[static_cast<size_t>(to)] / levels[static_cast<size_t>(from)]) /
           std::log(static_cast<double>(to) / from);
  };
  const double low = std::clamp(slope_at(kLowest + 1, 4 * kLowest), 0.5, 3.0),
               high = std::clamp(slope_at(200, kHighest), 0.5, 4.0);
  for (int i = 0; i <= kLowest; ++i)
    levels[static_cast<size_t>(i)] = levels[kLowest + 1] * std::pow(i / (kLowest + 1.0), low);
  for (int i = kHighest; i < kLevels; ++i)
    levels[static_cast<size_t>(i)] = levels[kHighest - 1] * std::pow(i / (kHighest - 1.0), high);
  for (size_t i = 1; i < levels.size(); ++i) levels[i] = std::max(levels[i], levels[i - 1]);
  const double top = levels.back();
  for (double& level : levels) level /= top;
}

double interpolate(const std::vector<double>& levels, double at) {
  const double clamped = std::clamp(at, 0.0, kLevels - 1.0);
  const auto below = std::min(static_cast<size_t>(clamped), levels.size() - 2);
  return levels[below] + (clamped - static_cast<double>(below)) * (levels[below + 1] - levels[below]);
}

// How well the exposures agree on each place's radiance.
double scatter(const std::vector<Place>& places, const std::vector<const Exposure*>& exposures,
               const std::vector<double>& levels) {
  double squares = 0;
  int count = 0;
  for (const Place& place : places) {
    std::vector<double> logs;
    for (size_t i = 0; i < exposures.size(); ++i)
      if (place.level[i] > 2 * kLowest && place.level[i] < kHighest)
        logs.push_back(std::log(interpolate(levels, place.level[i]) / *exposures[i]->exposure_s));
    double mean = 0;
    for (const double value : logs) mean += value / static_cast<double>(logs.size());
    for (const double value : logs) squares += (value - mean) * (value - mean);
    count += static_cast<int>(logs.size()) - 1;
  }
  return count > 0 ? std::sqrt(squares / count) : 0;
}

double nearest_gamma(const std::vector<double>& levels) {
  double xy = 0, xx = 0;
  for (int i = 20; i < kHighest; ++i) {
    const double x = std::log(i / 255.0), y = std::log(levels[static_cast<size_t>(i)]);
    xy += x * y, xx += x * x;
  }
  return xy / xx;
}

}  // namespace

MeasuredResponse measure_response(std::span<const Exposure> exposures, int bit_depth, ResponseMethod method) {
  const std::vector<const Exposure*> sorted = ordered(exposures);
  const double per_level = std::exp2(bit_depth - 8);
  const std::vector<Place> places =
      choose_places(sorted, per_level, method == ResponseMethod::debevec ? 384 : 4096);
  if (places.size() < 50)
    throw std::invalid_argument("only " + std::to_string(places.size()) +
                                " flat places with two usable exposures, expected at least 50 (a brighter "
                                "scene, or times nearer to each other)");
  std::vector<double> levels = solve(places, sorted, method);
  tidy(levels);
  MeasuredResponse result;
  result.samples = static_cast<int>(places.size());
  result.exposures = static_cast<int>(sorted.size());
  result.rms_rel = scatter(places, sorted, levels);
  result.best_gamma = nearest_gamma(levels);
  const auto entries = size_t{1} << bit_depth;
  for (size_t dn = 0; dn < entries; ++dn)
    result.curve.push_back(
        interpolate(levels, static_cast<double>(dn) * (kLevels - 1) / static_cast<double>(entries - 1)));
  return result;
}

}  // namespace lampglow::photometry
