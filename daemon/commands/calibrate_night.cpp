#include "daemon/commands/calibrate_night.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "daemon/sources/archive.h"
#include "estimator/inference/distances.h"
#include "estimator/inference/patches.h"
#include "estimator/inference/sun.h"
#include "estimator/learn_reference.h"

namespace lampglow::daemon {
namespace {

constexpr double kClearMor_m = 8000;  // frames this clear stand in for a clear reference

struct NightFrame {
  ArchiveBracket entry;
  double mor_m = 0;
};

std::optional<double> sun_altitude(TimePoint time, const Site& site) {
  if (!site.latitude_deg || !site.longitude_deg) return std::nullopt;
  return inference::sun_position(time, *site.latitude_deg, *site.longitude_deg).altitude_deg;
}

std::vector<NightFrame> night_frames(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                     const Site& site) {
  std::map<TimePoint, double> mor_of;
  for (const Truth& truth : truths)
    if (truth.mor_m && *truth.mor_m > 0) mor_of[truth.time_utc] = *truth.mor_m;
  std::vector<NightFrame> frames;
  for (const ArchiveBracket& entry : read_frames_csv(archive)) {
    const auto mor = mor_of.find(entry.time_utc);
    if (entry.role == FrameRole::observation && mor != mor_of.end() &&
        inference::for_night_patches(sun_altitude(entry.time_utc, site), false, site))
      frames.push_back({entry, mor->second});
  }
  return frames;
}

// The archive's own clear reference; without one, the first known frame that is clear enough.
std::optional<ClearReference> reference_of(const std::filesystem::path& archive, const Site& site,
                                           const std::vector<NightFrame>& frames,
                                           const EstimatorOptions& options) {
  std::vector<ArchiveBracket> entries = read_frames_csv(archive);
  std::erase_if(entries,
                [](const ArchiveBracket& entry) { return entry.role != FrameRole::clear_reference; });
  const auto clear = [](const NightFrame& frame) { return frame.mor_m >= kClearMor_m; };
  const auto clearest = std::find_if(frames.begin(), frames.end(), clear);
  if (entries.empty() && clearest != frames.end()) {
    entries.push_back(clearest->entry);
    entries.back().role = FrameRole::clear_reference;
    entries.back().reference_mor_m = clearest->mor_m;
  }
  return learn_reference(clear_brackets(archive, std::move(entries), site.camera), site, options);
}

bool lacks_distance(const Light& light) {
  return !light.distance_m;
}

NightCalibrationResult learn_lamp_distances(const std::filesystem::path& archive,
                                            const std::vector<NightFrame>& frames, Site& site) {
  const EstimatorOptions options;
  NightCalibrationResult result;
  const auto reference = reference_of(archive, site, frames, options);
  if (!reference) {
    result.report =
        "Lamps: no clear reference and no frame with a MOR of 8 km or more: distances not learned\n";
    return result;
  }
  std::vector<inference::DistanceFrame> measured;
  for (const NightFrame& frame : frames) {
    const auto image = photometry::to_radiance(load_bracket(archive, frame.entry, site.camera), site.camera);
    if (image.empty()) continue;
    const auto registered = photometry::register_frame(image, reference->catalogue, options.registration);
    measured.push_back(inference::fit_distances(image, registered, *reference,
                                                *inference::halo_model(options.model),
                                                kMorTimesExtinction / frame.mor_m, options.night));
  }
  for (Light& light : site.lights) {
    if (!lacks_distance(light)) continue;
    const inference::LearnedDistance learned = inference::combine_distances(measured, light.id);
    if (!learned.distance_m) {
      result.report += fmt::format("{}: {}\n", light.id, learned.why_not);
      continue;
    }
    light.distance_m = learned.distance_m;
    light.distance_sigma_m = learned.sigma_m;
    result.learned = true;
    result.report += fmt::format(
        "{}: {:.0f} m ± {:.0f} m from {} frames; halves of the frames differ by {:.0f} %\n", light.id,
        *learned.distance_m, learned.sigma_m, learned.frames, 100 * learned.halves_differ);
  }
  return result;
}

NightCalibrationResult learn_from_patches(const std::filesystem::path& archive,
                                          const std::vector<NightFrame>& frames, Site& site) {
  const inference::PatchOptions options;
  std::vector<inference::PatchFrame> known;
  for (const NightFrame& frame : frames) {
    const auto image = photometry::to_radiance(load_bracket(archive, frame.entry, site.camera), site.camera);
    if (image.empty()) continue;
    known.push_back({frame.entry.time_utc,
                     inference::patch_features(image, site.camera, options.patch_px, options.texture),
                     std::log(kMorTimesExtinction / frame.mor_m)});
  }
  const inference::PatchLearning learning = inference::learn_patches(known, options);
  NightCalibrationResult result;
  if (!learning.calibration) {
    result.report = "Night: nothing learned: " + learning.why_not + "\n";
    return result;
  }
  site.night = learning.calibration;
  result.learned = true;
  result.report = fmt::format(
      "Night: learned from {} frames; half hours left out in turn were foretold with an error of {:.2f} in "
      "ln σ "
      "(rms), rank "
      "correlation {:.2f}, fog told from no fog at 1000 m in {:.0f} %\n",
      learning.frames, learning.rms_ln, learning.correlation, 100 * learning.fog_right);
  return result;
}

}  // namespace

NightCalibrationResult calibrate_night(const std::filesystem::path& archive, const std::vector<Truth>& truths,
                                       Site& site) {
  const std::vector<NightFrame> frames = night_frames(archive, truths, site);
  const bool known = std::none_of(site.lights.begin(), site.lights.end(), lacks_distance);
  if (!site.lights.empty() && known) return {false, "Lamps: every distance is known, nothing to learn\n"};
  if (!site.lights.empty() && site.camera.focal_length_px) return learn_lamp_distances(archive, frames, site);
  return learn_from_patches(archive, frames, site);
}

}  // namespace lampglow::daemon
