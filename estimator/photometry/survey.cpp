// Lights of several pictures of one view: lamps stay, cars move, hot pixels stay where the sensor is.
#include <algorithm>
#include <cmath>
#include <optional>

#include "estimator/photometry/lamps.h"
#include "estimator/photometry/median.h"

namespace lampglow::photometry {
namespace {

struct Shift {
  double x = 0, y = 0;
};

constexpr double kMaxShiftPx = 15;
constexpr double kSamePlacePx = 2;
constexpr size_t kBrightest = 30;

// The shift that brings most bright lights of `from` onto lights of `to`; then the median over those.
Shift shift_between(const std::vector<DetectedLight>& from, const std::vector<DetectedLight>& to) {
  Shift best;
  double best_score = -1;
  const size_t n = std::min(from.size(), kBrightest), m = std::min(to.size(), kBrightest);
  const auto pairs = [&](Shift shift, double tolerance, auto&& use) {
    for (size_t i = 0; i < n; ++i)
      for (size_t j = 0; j < m; ++j) {
        const double dx = to[j].x_px - from[i].x_px, dy = to[j].y_px - from[i].y_px;
        if (std::hypot(dx - shift.x, dy - shift.y) < tolerance) use(dx, dy);
      }
  };
  pairs({}, kMaxShiftPx, [&](double dx, double dy) {
    double score = -0.02 * std::hypot(dx, dy);
    pairs({dx, dy}, 1, [&](double, double) { score += 1; });
    if (score > best_score) best_score = score, best = {dx, dy};
  });
  std::vector<double> x, y;
  pairs(best, 1, [&](double dx, double dy) { x.push_back(dx), y.push_back(dy); });
  if (!x.empty()) best = {median_of(x), median_of(y)};
  return best;
}

// Sightings of what is taken for one light.
struct Group {
  std::vector<DetectedLight> sightings;
  double x_px = 0, y_px = 0;  // of the first
};

// Puts each frame's lights, moved back by `shifts`, to the group in that place.
std::vector<Group> group_lights(std::span<const std::vector<DetectedLight>> frames,
                                const std::vector<Shift>& shifts, double tolerance_px) {
  std::vector<Group> groups;
  for (size_t f = 0; f < frames.size(); ++f) {
    std::vector<bool> taken(groups.size());
    for (DetectedLight light : frames[f]) {
      light.x_px -= shifts[f].x, light.y_px -= shifts[f].y;
      std::optional<size_t> nearest;
      // A wide saturated core has no sharp middle, and its outline changes from frame to frame.
      double way = std::max(tolerance_px, light.saturated_pixels > 0 ? 0.5 * light.fwhm_px : 0.0);
      for (size_t g = 0; g < taken.size(); ++g) {
        const double distance = std::hypot(groups[g].x_px - light.x_px, groups[g].y_px - light.y_px);
        if (!taken[g] && distance < way) way = distance, nearest = g;
      }
      if (nearest) {
        taken[*nearest] = true;
        groups[*nearest].sightings.push_back(light);
      } else {
        groups.push_back({{light}, light.x_px, light.y_px});
      }
    }
  }
  return groups;
}

template <typename Field>
double median_field(const Group& group, Field field) {
  std::vector<double> values;
  for (const DetectedLight& light : group.sightings) values.push_back(field(light));
  return median_of(values);
}

SurveyedLight summarise(const Group& group) {
  SurveyedLight result;
  result.light = group.sightings.front();
  DetectedLight& light = result.light;
  light.x_px = median_field(group, [](const auto& s) { return s.x_px; });
  light.y_px = median_field(group, [](const auto& s) { return s.y_px; });
  light.flux = median_field(group, [](const auto& s) { return s.flux; });
  light.fwhm_px = median_field(group, [](const auto& s) { return s.fwhm_px; });
  light.snr = median_field(group, [](const auto& s) { return s.snr; });
  light.peak = median_field(group, [](const auto& s) { return s.peak; });
  light.saturated_pixels =
      static_cast<int>(median_field(group, [](const auto& s) { return 1.0 * s.saturated_pixels; }));
  result.frames_seen = static_cast<int>(group.sightings.size());
  const double middle = light.flux;
  const double scatter = median_field(group, [middle](const auto& s) { return std::abs(s.flux - middle); });
  result.flux_rel_scatter = middle > 0 ? 1.4826 * scatter / middle : 0;
  return result;
}

double scatter_px(const Group& group) {
  const double x = median_field(group, [](const auto& s) { return s.x_px; });
  const double y = median_field(group, [](const auto& s) { return s.y_px; });
  return median_field(group, [x, y](const auto& s) { return std::hypot(s.x_px - x, s.y_px - y); });
}

// Pixels of the sensor on which something shines whatever the camera's pose: only to be told if it moved.
std::vector<PixelIndex> fixed_to_sensor(std::span<const std::vector<DetectedLight>> frames,
                                        const std::vector<Shift>& shifts) {
  std::vector<PixelIndex> hot;
  std::vector<double> ways;
  ways.reserve(shifts.size());
  for (const Shift& shift : shifts) ways.push_back(std::hypot(shift.x, shift.y));
  if (frames.size() < 4 || median_of(ways) < 1) return hot;
  const std::vector<Shift> still(frames.size());
  for (const Group& group : group_lights(frames, still, 0.7)) {
    if (group.sightings.size() * 4 < frames.size() * 3 || scatter_px(group) > 0.25) continue;
    hot.push_back({static_cast<int>(median_field(group, [](const auto& s) { return s.x_px; })),
                   static_cast<int>(median_field(group, [](const auto& s) { return s.y_px; }))});
  }
  return hot;
}

}  // namespace

Survey survey_lights(std::span<const std::vector<DetectedLight>> frames) {
  Survey survey;
  survey.frames = static_cast<int>(frames.size());
  std::vector<Shift> shifts;
  for (const auto& frame : frames) shifts.push_back(shift_between(frames.front(), frame));
  survey.hot_pixels = fixed_to_sensor(frames, shifts);

  std::vector<std::vector<DetectedLight>> lights(frames.begin(), frames.end());
  for (auto& frame : lights)
    std::erase_if(frame, [&](const DetectedLight& light) {
      return std::any_of(survey.hot_pixels.begin(), survey.hot_pixels.end(), [&](const PixelIndex& hot) {
        return std::hypot(hot.column + 0.5 - light.x_px, hot.row + 0.5 - light.y_px) < 1.2;
      });
    });
  for (const Group& group : group_lights(lights, shifts, kSamePlacePx)) {
    const bool lamp =
        group.sightings.size() * 2 >= frames.size() && (frames.size() < 2 || group.sightings.size() >= 2);
    (lamp ? survey.lamps : survey.moving).push_back(summarise(group));
  }
  const auto brighter = [](const SurveyedLight& a, const SurveyedLight& b) {
    return a.light.flux > b.light.flux;
  };
  std::stable_sort(survey.lamps.begin(), survey.lamps.end(), brighter);
  std::stable_sort(survey.moving.begin(), survey.moving.end(), brighter);
  return survey;
}

}  // namespace lampglow::photometry
