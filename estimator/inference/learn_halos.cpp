#include "estimator/inference/learn_halos.h"

#include <algorithm>
#include <cmath>

namespace lampglow::inference {
namespace {

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 != 0) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

// Any of these is a reason not to take a frame's word on details.
bool doubtful(const Observation& observation) {
  for (const Quality flag :
       {Quality::fit_not_converged, Quality::not_registered, Quality::few_lights, Quality::automatic_exposure,
        Quality::poor_fit, Quality::at_bound, Quality::daylight, Quality::twilight})
    if (observation.quality.has(flag)) return true;
  return false;
}

// A beam that is seen, at its usual power: the halo is then measured against it, and not against a prior.
bool tells(const LampFit& lamp, const HaloOptions& options) {
  return lamp.state == LampState::seen && lamp.ln_halo && lamp.ln_halo_sigma &&
         *lamp.ln_halo_sigma < options.most_ln_sigma && lamp.strength_ratio &&
         std::abs(std::log(*lamp.strength_ratio)) < options.usual_ln;
}

// No lamp may stand for all others, however sure it is: hence the floor.
double weight(const HaloReading& reading, const HaloOptions& options) {
  return 1 / (reading.sigma * reading.sigma + options.floor_ln_sigma * options.floor_ln_sigma);
}

// Takes off what all share.
void against_the_mean(HaloFrame& frame, const HaloOptions& options) {
  double sum = 0, weights = 0;
  for (const auto& reading : frame)
    if (reading) sum += weight(*reading, options) * reading->ln_halo, weights += weight(*reading, options);
  for (auto& reading : frame)
    if (reading) reading->ln_halo -= sum / weights;
}

struct Taught {
  size_t lamp = 0;
  double ln_halo = 0, error = 0;
};

// The median of a lamp's readings, with its error from their scatter; empty if they are too few.
std::optional<Taught> taught_of(size_t lamp, std::span<const HaloFrame> frames, const HaloOptions& options) {
  std::vector<double> readings;
  for (const HaloFrame& frame : frames)
    if (frame[lamp]) readings.push_back(frame[lamp]->ln_halo);
  if (static_cast<int>(readings.size()) < options.least_frames) return std::nullopt;
  const double median = median_of(readings);
  std::vector<double> off;
  for (const double reading : readings) off.push_back(std::abs(reading - median));
  constexpr double kMadToSigma = 1.4826, kOfMedian = 1.2533;  // of normal errors
  const double scatter =
      kMadToSigma * kOfMedian * median_of(off) / std::sqrt(static_cast<double>(readings.size()));
  const double error = std::hypot(scatter, options.floor_ln_sigma);
  if (error > options.most_error) return std::nullopt;
  return Taught{lamp, median, error};
}

std::vector<Taught> taught_lamps(std::span<const HaloFrame> frames, size_t lamps,
                                 const HaloOptions& options) {
  std::vector<Taught> all;
  double mean = 0;
  for (size_t j = 0; j < lamps; ++j)
    if (const auto taught = taught_of(j, frames, options)) all.push_back(*taught), mean += taught->ln_halo;
  for (Taught& taught : all) taught.ln_halo -= mean / static_cast<double>(all.size());
  return all;
}

// What the lamps share is taken off the steps as well, so that the sum over the lamps stays what it was.
std::vector<double> steps_of(const std::vector<Taught>& taught, const ClearReference& reference,
                             const HaloOptions& options) {
  std::vector<double> steps(reference.lamps.size(), 0.0);
  double mean = 0;
  for (const Taught& lamp : taught) {
    const double now = reference.lamps[lamp.lamp].ln_halo;
    const double target = std::clamp(now + lamp.ln_halo, -options.farthest_ln, options.farthest_ln);
    double& step = steps[lamp.lamp];
    step = std::clamp(options.step_part * (target - now), -options.step_cap, options.step_cap);
    mean += step / static_cast<double>(taught.size());
  }
  for (const Taught& lamp : taught) steps[lamp.lamp] -= mean;
  return steps;
}

}  // namespace

std::optional<HaloFrame> halo_frame(const FrameResult& result, const ClearReference& reference,
                                    const HaloOptions& options) {
  const Observation& observation = result.observation;
  if (observation.method != Method::glow || !observation.extinction_per_m ||
      observation.limit != Limit::none || observation.q.value_or(1) > options.most_q || doubtful(observation))
    return std::nullopt;
  HaloFrame frame(reference.lamps.size());
  int lamps = 0;
  for (size_t j = 0; j < frame.size(); ++j)
    for (const LampFit& lamp : result.lamps)
      if (lamp.id == reference.lamps[j].id && tells(lamp, options)) {
        frame[j] = HaloReading{*lamp.ln_halo, *lamp.ln_halo_sigma};
        ++lamps;
      }
  if (lamps < options.least_lamps) return std::nullopt;
  against_the_mean(frame, options);
  return frame;
}

HaloLesson learn_halos(std::span<const HaloFrame> frames, const ClearReference& reference,
                       const HaloOptions& options) {
  HaloLesson lesson;
  lesson.frames = static_cast<int>(frames.size());
  const auto taught = taught_lamps(frames, reference.lamps.size(), options);
  if (static_cast<int>(taught.size()) < options.least_lamps) {
    lesson.why_not = "too few frames of haze or fog tell of the lamps' halos";
    return lesson;
  }
  const bool differ = std::any_of(taught.begin(), taught.end(), [&](const Taught& lamp) {
    return std::abs(lamp.ln_halo) > options.clear_difference * lamp.error;
  });
  if (differ)
    lesson.ln_step = steps_of(taught, reference, options);
  else
    lesson.why_not = "no lamp's halo differs from the others' by more than its error";
  return lesson;
}

ClearReference with_halos(const ClearReference& reference, std::span<const double> ln_change, TimePoint now) {
  ClearReference changed = reference;
  for (size_t j = 0; j < ln_change.size(); ++j) {
    if (ln_change[j] == 0) continue;
    changed.lamps[j].ln_halo += ln_change[j];
    changed.lamps[j].halo_utc = now;
  }
  changed.scene = std::make_shared<const Scene>(reference.scene->with_halos(ln_change));
  return changed;
}

}  // namespace lampglow::inference
