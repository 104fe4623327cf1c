#include "daemon/schedule/adapt.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lampglow::daemon {
namespace {

struct Measured {
  double peak = 0;   // of the lamps, as share of the range over black; 1 is saturated
  double sky = 0;    // median, the same unit
  double noise = 0;  // one standard deviation of a pixel, the same unit
};

// The n-th largest of all pixels.
double brightest(Pixels<std::uint16_t> pixels, std::size_t rank) {
  std::ranges::nth_element(pixels, pixels.begin() + static_cast<std::ptrdiff_t>(rank), std::greater<>());
  return pixels[rank];
}

// Noise from differences of horizontal neighbours: their median absolute value is 0.954 sigma for Gaussian
// noise (0.6745 * sqrt 2). Quantisation to whole DN leaves at least 1/sqrt 12.
double neighbour_noise_dn(const Image<std::uint16_t>& picture) {
  Pixels<std::uint16_t> differences;
  differences.reserve(picture.pixels.size());
  for (std::size_t i = 1; i < picture.pixels.size(); ++i) {
    differences.push_back(static_cast<std::uint16_t>(std::abs(picture.pixels[i] - picture.pixels[i - 1])));
  }
  if (differences.empty()) return 1 / std::sqrt(12.0);
  const double median = brightest(std::move(differences), picture.pixels.size() / 2);
  return std::max(median / 0.954, 1 / std::sqrt(12.0));
}

Measured measure(const Exposure& exposure, const AdaptOptions& options) {
  const double range = options.saturation_dn - options.black_level_dn;
  const auto& pixels = exposure.pixels.pixels;
  const std::size_t rank = std::min(pixels.size() - 1, std::max<std::size_t>(4, pixels.size() / 100'000));
  return {(brightest(pixels, rank) - options.black_level_dn) / range,
          (brightest(pixels, pixels.size() / 2) - options.black_level_dn) / range,
          neighbour_noise_dn(exposure.pixels) / range};
}

double shortest_factor(const Measured& lamps, bool may_grow) {
  if (lamps.peak >= 0.98) return 0.25;  // clipped: how far over is not known
  if (lamps.peak > 0.85) return 0.6 / lamps.peak;
  if (lamps.peak < 0.25 && may_grow) return std::min(4.0, 0.5 / std::max(lamps.peak, 0.01));
  return 1;
}

double longest_factor(const Measured& sky) {
  if (sky.sky > 0.4) return std::max(0.25, 0.2 / sky.sky);
  if (sky.sky < 6 * sky.noise) return std::min(4.0, 9 * sky.noise / std::max(sky.sky, sky.noise));
  return 1;
}

// Shortest to longest in equal ratios of at most largest_step.
std::vector<ExposureSetting> ladder_between(double shortest_s, double longest_s,
                                            std::optional<double> gain_db, const AdaptOptions& options) {
  const double ratio = longest_s / shortest_s;
  const int wanted =
      ratio <= 1.0001
          ? 1
          : 1 + static_cast<int>(std::ceil(std::log(ratio) / std::log(options.largest_step) - 1e-6));
  const int count = std::clamp(wanted, 1, std::max(options.most_exposures, 1));
  std::vector<ExposureSetting> bracket;
  for (int i = 0; i < count; ++i) {
    const double share = count == 1 ? 0 : static_cast<double>(i) / (count - 1);
    bracket.push_back({shortest_s * std::pow(ratio, share), gain_db});
  }
  return bracket;
}

}  // namespace

std::vector<ExposureSetting> adapt_bracket(const std::vector<ExposureSetting>& current,
                                           const Bracket& bracket, const AdaptOptions& options) {
  const auto unknown = [](const Exposure& exposure) {
    return !exposure.exposure_s || exposure.pixels.empty();
  };
  if (bracket.exposures.empty() || std::ranges::any_of(bracket.exposures, unknown)) return current;
  const auto [shortest, longest] = std::ranges::minmax_element(
      bracket.exposures, {}, [](const Exposure& exposure) { return *exposure.exposure_s; });

  const double down = shortest_factor(measure(*shortest, options), shortest != longest);
  const double up = longest_factor(measure(*longest, options));
  if (down == 1 && up == 1) return current;
  const double shortest_s =
      std::clamp(*shortest->exposure_s * down, options.exposure_min_s, options.exposure_max_s);
  const double longest_s = std::clamp(*longest->exposure_s * up, shortest_s, options.exposure_max_s);
  const auto gain_db = current.empty() ? std::nullopt : current.front().gain_db;
  return ladder_between(shortest_s, longest_s, gain_db, options);
}

}  // namespace lampglow::daemon
