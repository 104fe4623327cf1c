#include "daemon/commands/calibrate_day.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "daemon/sources/archive.h"
#include "estimator/inference/calibrate_day.h"
#include "estimator/inference/patches.h"
#include "estimator/inference/sun.h"
#include "estimator/photometry/radiance.h"
#include "estimator/photometry/targets.h"

namespace lampglow::daemon {
namespace {

constexpr double kLeastSun_deg = -3;  // frames to learn targets from
constexpr double kLeastSunPatches_deg = -8;
constexpr double kLeastSunClear_deg = 4;  // frames to find targets in
constexpr std::size_t kMostClear = 12;

struct DayFrame {
  ArchiveBracket entry;
  double mor_m = 0;
  double sun_altitude_deg = 90;
};

// The archive's daylight frames with a truth, by the sun's altitude.
std::vector<DayFrame> daylight_frames(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                      const Site& site) {
  std::map<TimePoint, double> mor_of;
  for (const Truth& truth : truths)
    if (truth.mor_m && *truth.mor_m > 0) mor_of[truth.time_utc] = *truth.mor_m;
  std::vector<DayFrame> frames;
  for (const ArchiveBracket& entry : read_frames_csv(archive)) {
    const auto mor = mor_of.find(entry.time_utc);
    const auto sun = inference::sun_position(entry.time_utc, *site.latitude_deg, *site.longitude_deg);
    if (mor == mor_of.end() || sun.altitude_deg < kLeastSunPatches_deg) continue;
    frames.push_back({entry, mor->second, sun.altitude_deg});
  }
  return frames;
}

bool is_colour(const Bracket& bracket) {
  return std::any_of(bracket.exposures.begin(), bracket.exposures.end(),
                     [](const Exposure& e) { return !e.monochrome; });
}

// The third of the frames with the farthest visibility, thinned evenly.
std::vector<DayFrame> clearest(const std::vector<DayFrame>& frames) {
  std::vector<DayFrame> high;
  for (const DayFrame& frame : frames)
    if (frame.sun_altitude_deg >= kLeastSunClear_deg) high.push_back(frame);
  if (high.empty()) high = frames;
  std::vector<double> mors;
  mors.reserve(high.size());
  for (const DayFrame& frame : high) mors.push_back(frame.mor_m);
  std::sort(mors.begin(), mors.end());
  const double least = mors[mors.size() * 2 / 3];
  std::erase_if(high, [&](const DayFrame& frame) { return frame.mor_m < least; });
  std::vector<DayFrame> chosen;
  const std::size_t step = (high.size() + kMostClear - 1) / kMostClear;
  for (std::size_t i = 0; i < high.size(); i += step) chosen.push_back(high[i]);
  return chosen;
}

bool crosses_skyline(const Target& target, const std::vector<int>& skyline_px) {
  int inside = 0;
  for (int x = static_cast<int>(target.x_px); x < static_cast<int>(target.x_px + target.width_px); ++x) {
    const int row = skyline_px[std::min(static_cast<std::size_t>(x), skyline_px.size() - 1)];
    inside += row >= target.y_px && row < target.y_px + target.height_px;
  }
  return inside > 0.3 * target.width_px;
}

photometry::DaySurvey survey(const std::filesystem::path& archive, const std::vector<DayFrame>& frames,
                             const Site& site) {
  std::vector<photometry::RadianceImage> clear;
  for (const DayFrame& frame : clearest(frames)) {
    photometry::RadianceImage image =
        photometry::to_radiance(load_bracket(archive, frame.entry, site.camera), site.camera);
    if (!image.empty()) clear.push_back(std::move(image));
  }
  photometry::DaySurvey found = photometry::survey_day(clear);
  if (site.targets.empty() || site.day) return found;
  found.targets = site.targets;  // set by hand
  found.skyline.clear();
  if (found.skyline_px.empty()) found.skyline_px.assign(1, -1);
  for (const Target& target : found.targets)
    found.skyline.push_back(crosses_skyline(target, found.skyline_px));
  return found;
}

// Intrinsic brightness of targets of known distance, from the frames in which they are little veiled.
int learn_brightness(const std::vector<inference::DaySample>& samples, Site& site) {
  int learned = 0;
  for (std::size_t i = 0; i < site.targets.size(); ++i) {
    Target& target = site.targets[i];
    std::vector<double> intrinsic;
    for (const inference::DaySample& sample : samples) {
      const auto ratio = sample.view.targets[i].brightness_ratio;
      const double transmission = std::exp(-kMorTimesExtinction / sample.mor_m * *target.distance_m);
      if (ratio && transmission > 0.4) intrinsic.push_back(1 - (1 - *ratio) / transmission);
    }
    if (intrinsic.size() < 5) continue;
    double mean = 0, variance = 0;
    for (const double r0 : intrinsic) mean += r0 / static_cast<double>(intrinsic.size());
    for (const double r0 : intrinsic)
      variance += (r0 - mean) * (r0 - mean) / static_cast<double>(intrinsic.size() - 1);
    target.brightness_ratio = std::clamp(mean, 0.0, 1.0);
    target.brightness_ratio_sigma = std::max(std::sqrt(variance), 0.01);
    ++learned;
  }
  return learned;
}

bool all_distances_known(const Site& site) {
  return !site.targets.empty() && !site.day &&
         std::all_of(site.targets.begin(), site.targets.end(), [](const Target& t) { return t.distance_m; });
}

std::string describe(const inference::DayLearning& learning, double least_mor_m, double most_mor_m) {
  std::string text = fmt::format("day: {} targets learned from {} frames, MOR {:.0f} to {:.0f} m\n",
                                 learning.targets.size(), learning.samples, least_mor_m, most_mor_m);
  if (learning.cross_validated > 0)
    text += fmt::format("day: {} frames estimated from the other hours: median |ln(estimate/truth)| {:.2f}\n",
                        learning.cross_validated, learning.cross_median_abs_ln);
  else
    text += "day: too few hours to cross-validate; the error is an assumption\n";
  return text;
}

// The picture's patches, if they foretell the hours left out better than the targets do.
void learn_day_patches(const std::filesystem::path& archive, const std::vector<DayFrame>& frames, bool colour,
                       const std::optional<inference::DayLearning>& targets, Site& site,
                       DayCalibrationResult& result) {
  inference::PatchOptions options;
  options.texture = true;
  std::vector<inference::PatchFrame> known;
  for (const DayFrame& frame : frames) {
    const Bracket bracket = load_bracket(archive, frame.entry, site.camera);
    const photometry::RadianceImage image = photometry::to_radiance(bracket, site.camera);
    if (image.empty() || is_colour(bracket) != colour) continue;
    known.push_back({frame.entry.time_utc,
                     inference::patch_features(image, site.camera, options.patch_px, options.texture),
                     std::log(kMorTimesExtinction / frame.mor_m)});
  }
  const inference::PatchLearning half_hours = inference::learn_patches(known, options);
  options.block_s = 3600;
  const inference::PatchLearning hours = inference::learn_patches(known, options);
  site.day_patches.reset();
  if (!half_hours.calibration || !hours.calibration) {
    result.report += "day: patches: nothing learned: " + half_hours.why_not + hours.why_not + "\n";
    return;
  }
  const bool better =
      !targets || targets->cross_validated == 0 || hours.median_abs_ln < targets->cross_median_abs_ln;
  result.report += fmt::format(
      "day: patches of {} frames: hours left out in turn were foretold with a median |ln(estimate/truth)| of "
      "{:.2f}, "
      "half hours with a root mean square of {:.2f}, rank correlation {:.2f}; {}\n",
      known.size(), hours.median_abs_ln, half_hours.rms_ln, half_hours.correlation,
      better ? "they answer by day" : "targets foretell better and answer by day");
  if (!better) return;
  site.day_patches = half_hours.calibration;
  site.day_patches->colour = colour;
  result.learned = true;
}

}  // namespace

DayCalibrationResult calibrate_day(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                   Site& site) {
  if (!site.latitude_deg || !site.longitude_deg)
    return {
        false,
        "day: nothing learned: latitude_deg and longitude_deg are missing, so day and night can't be told\n"};
  std::vector<DayFrame> frames = daylight_frames(archive, truths, site);
  const std::vector<DayFrame> with_twilight = frames;
  std::erase_if(frames, [](const DayFrame& frame) { return frame.sun_altitude_deg < kLeastSun_deg; });
  if (frames.empty()) return {false, "day: nothing learned: no daylight frame has a known visibility\n"};

  const bool known = all_distances_known(site);
  const photometry::DaySurvey found = known ? photometry::DaySurvey{} : survey(archive, frames, site);
  if (!known && found.targets.empty())
    return {false, "day: nothing learned: no sky above a darker skyline in the clearest frames\n"};
  const std::vector<Target>& targets = known ? site.targets : found.targets;
  const std::optional<DayCalibration> day = known ? std::nullopt : std::optional(found.day);

  // Colour pictures and the monochrome ones of a night mode are two cameras: the more frequent kind counts.
  std::vector<inference::DaySample> samples[2];
  for (const DayFrame& frame : frames) {
    const Bracket bracket = load_bracket(archive, frame.entry, site.camera);
    const photometry::RadianceImage image = photometry::to_radiance(bracket, site.camera);
    if (image.empty()) continue;
    samples[is_colour(bracket)].push_back(
        {frame.entry.time_utc, frame.mor_m, inference::view_targets(image, targets, day)});
  }
  const bool colour = samples[1].size() >= samples[0].size();
  const std::vector<inference::DaySample>& used = samples[colour];
  if (known) {
    const int learned = learn_brightness(used, site);
    return {learned > 0, fmt::format("day: intrinsic brightness of {} of {} targets learned from {} frames\n",
                                     learned, site.targets.size(), used.size())};
  }
  std::string why;
  const auto learning = inference::learn_day(used, targets, found.skyline, *day, {}, why);
  DayCalibrationResult result;
  if (learning) {
    const auto [least, most] = std::minmax_element(
        used.begin(), used.end(), [](const auto& a, const auto& b) { return a.mor_m < b.mor_m; });
    site.targets = learning->targets;
    site.day = learning->day;
    site.day->colour = colour;
    result = {true, describe(*learning, least->mor_m, most->mor_m)};
  } else {
    result.report = "day: no targets learned: " + why + "\n";
  }
  learn_day_patches(archive, with_twilight, colour, learning, site, result);
  return result;
}

}  // namespace lampglow::daemon
