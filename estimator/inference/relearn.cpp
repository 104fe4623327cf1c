#include "estimator/inference/relearn.h"

#include <algorithm>
#include <cmath>

namespace lampglow::inference {
namespace {

using Hours = std::chrono::duration<double, std::ratio<3600>>;

double hours_between(const NightFrame& from, const NightFrame& to) {
  return Hours(to.time_utc - from.time_utc).count();
}

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  if (values.size() % 2 != 0) return *middle;
  return (*middle + *std::max_element(values.begin(), middle)) / 2;
}

// Any of these is a reason to doubt that the air is clear.
bool doubtful(const Observation& observation) {
  for (const Quality flag : {Quality::fit_not_converged, Quality::not_registered, Quality::few_lights,
                             Quality::automatic_exposure, Quality::limit_below})
    if (observation.quality.has(flag)) return true;
  return false;
}

// Droplets scatter forward; a glow whose shape is known and is theirs hints at fog, thin as it may be.
bool glows_like_droplets(const Observation& observation) {
  constexpr double kDropletQ = 0.8;
  return observation.q_low && *observation.q_low > kDropletQ;
}

std::optional<double> lower_bound_of_mor(const Observation& observation) {
  if (observation.limit == Limit::above) return observation.mor_m();
  return observation.mor_low_m();
}

// First and one past the last frame of the night's longest time without a doubt, its margins taken off.
struct Run {
  size_t first = 0, end = 0;
};

Run without_margins(std::span<const NightFrame> frames, Run run, const RelearnOptions& options) {
  Run inner = run;
  while (run.first > 0 && inner.first < run.end &&
         hours_between(frames[run.first - 1], frames[inner.first]) < options.margin_h)
    ++inner.first;
  while (run.end < frames.size() && inner.end > inner.first &&
         hours_between(frames[inner.end - 1], frames[run.end]) < options.margin_h)
    --inner.end;
  return inner;
}

double length_of(std::span<const NightFrame> frames, const Run& run) {
  return run.end > run.first + 1 ? hours_between(frames[run.first], frames[run.end - 1]) : 0;
}

Run longest_clear_run(std::span<const NightFrame> frames, const RelearnOptions& options) {
  Run best;
  for (size_t first = 0; first < frames.size();) {
    if (!frames[first].clear_mor_m) {
      ++first;
      continue;
    }
    Run run{first, first + 1};
    while (run.end < frames.size() && frames[run.end].clear_mor_m &&
           hours_between(frames[run.end - 1], frames[run.end]) <= options.longest_gap_h)
      ++run.end;
    first = run.end;
    const Run inner = without_margins(frames, run, options);
    if (length_of(frames, inner) > length_of(frames, best)) best = inner;
  }
  return best;
}

struct Seen {
  size_t lamp;
  double distance_m;
  double ln_ratio;  // median over the frames
};

// Lamps that burned at their usual power in most of the frames.
std::vector<Seen> usual_lamps(std::span<const NightFrame> frames, const ClearReference& reference,
                              const RelearnOptions& options) {
  std::vector<Seen> seen;
  for (size_t j = 0; j < reference.scene->lamps().size(); ++j) {
    const SceneLamp& lamp = reference.scene->lamps()[j];
    if (!lamp.catalogued || !lamp.distance_m || !lamp.core_seen) continue;
    std::vector<double> ratios;
    for (const NightFrame& frame : frames)
      if (frame.ln_ratio[j] && std::abs(*frame.ln_ratio[j]) < options.usual_ln)
        ratios.push_back(*frame.ln_ratio[j]);
    if (static_cast<double>(ratios.size()) < options.least_part * static_cast<double>(frames.size()))
      continue;
    seen.push_back({j, *lamp.distance_m, median_of(std::move(ratios))});
  }
  return seen;
}

struct Line {
  double at_camera = 0, slope_per_m = 0;
  double at(double distance_m) const { return at_camera + slope_per_m * distance_m; }
};

Line line_through(const std::vector<Seen>& lamps) {
  double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
  for (const Seen& lamp : lamps) {
    n += 1;
    sx += lamp.distance_m;
    sy += lamp.ln_ratio;
    sxx += lamp.distance_m * lamp.distance_m;
    sxy += lamp.distance_m * lamp.ln_ratio;
  }
  const double spread = n * sxx - sx * sx;
  if (!(spread > 0)) return {sy / n, 0};
  const double slope = (n * sxy - sx * sy) / spread;
  return {(sy - slope * sx) / n, slope};
}

bool reaches(const std::vector<Seen>& lamps, const RelearnOptions& options) {
  if (static_cast<int>(lamps.size()) < options.least_lamps) return false;
  const auto [near, far] = std::minmax_element(
      lamps.begin(), lamps.end(), [](const Seen& a, const Seen& b) { return a.distance_m < b.distance_m; });
  return far->distance_m >= options.least_reach * near->distance_m;
}

// Leaves out, one by one, the lamp that is farthest off the line through the others, until all agree.
std::vector<Seen> agreeing(std::vector<Seen> lamps, const RelearnOptions& options) {
  while (lamps.size() > 2) {
    size_t worst = 0;
    double off = 0;
    for (size_t i = 0; i < lamps.size(); ++i) {
      std::vector<Seen> others = lamps;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      const double residual = std::abs(lamps[i].ln_ratio - line_through(others).at(lamps[i].distance_m));
      if (residual > off) off = residual, worst = i;
    }
    const double own = std::abs(lamps[worst].ln_ratio - line_through(lamps).at(lamps[worst].distance_m));
    if (own <= options.agree_ln) break;
    lamps.erase(lamps.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  return lamps;
}

}  // namespace

std::optional<NightFrame> night_frame(const FrameResult& result, const ClearReference& reference,
                                      const RelearnOptions& options) {
  const Observation& observation = result.observation;
  if (observation.method != Method::glow || observation.quality.has(Quality::daylight) ||
      observation.quality.has(Quality::twilight) || !reference.scene)
    return std::nullopt;
  NightFrame frame{observation.time_utc, {}, {}};
  frame.ln_ratio.resize(reference.scene->lamps().size());
  const auto mor = lower_bound_of_mor(observation);
  if (mor && *mor >= options.clear_mor_m && !doubtful(observation) && !glows_like_droplets(observation))
    frame.clear_mor_m = mor;
  // A poor fit's bound is a wide one and holds; its strengths may be those of a passing car.
  if (observation.quality.has(Quality::poor_fit)) return frame;
  for (size_t j = 0; j < frame.ln_ratio.size(); ++j)
    for (const LampFit& lamp : result.lamps)
      if (lamp.id == reference.scene->lamps()[j].id && lamp.state == LampState::seen && lamp.strength_ratio)
        frame.ln_ratio[j] = std::log(*lamp.strength_ratio);
  return frame;
}

Lesson learn_from_night(std::span<const NightFrame> frames, const ClearReference& reference,
                        const RelearnOptions& options) {
  Lesson lesson;
  lesson.ln_step.assign(reference.scene->lamps().size(), 0.0);
  const auto not_learned = [&](std::string why) {
    lesson.why_not = std::move(why);
    return lesson;
  };
  const Run run = longest_clear_run(frames, options);
  const auto clear = frames.subspan(run.first, run.end - run.first);
  lesson.frames = static_cast<int>(clear.size());
  lesson.hours = length_of(frames, run);
  if (lesson.frames < options.least_frames || lesson.hours < options.least_hours)
    return not_learned("the air was not clear beyond doubt for long enough");
  lesson.lowest_mor_m = *std::min_element(clear.begin(), clear.end(), [](const auto& a, const auto& b) {
                           return *a.clear_mor_m < *b.clear_mor_m;
                         })->clear_mor_m;
  const std::vector<Seen> burning = usual_lamps(clear, reference, options);
  const std::vector<Seen> lamps = agreeing(burning, options);
  lesson.lamps = static_cast<int>(lamps.size());
  for (const Seen& lamp : burning)
    if (std::none_of(lamps.begin(), lamps.end(), [&](const Seen& other) { return other.lamp == lamp.lamp; }))
      lesson.left_out.push_back(reference.lamps[lamp.lamp].id);
  if (!reaches(lamps, options)) return not_learned("too few lamps at different distances agree");
  const Line line = line_through(lamps);
  lesson.ln_common = line.at_camera;
  lesson.slope_per_m = line.slope_per_m;
  // Lamps that fade with distance as in air at the limit of what counts as clear: it may not have been clear.
  if (-line.slope_per_m > kMorTimesExtinction / options.clear_mor_m)
    return not_learned("lamps are weaker with distance, as fog makes them");
  const auto step = [&](double ln) {
    return std::clamp(options.step_part * ln, -options.step_cap, options.step_cap);
  };
  // The window is before all lamps, also those that were out or are in no catalogue.
  std::fill(lesson.ln_step.begin(), lesson.ln_step.end(), step(line.at_camera));
  for (const Seen& lamp : lamps)
    lesson.ln_step[lamp.lamp] = step(lamp.ln_ratio - line.slope_per_m * lamp.distance_m);
  const bool changed = std::any_of(lesson.ln_step.begin(), lesson.ln_step.end(),
                                   [&](double ln) { return std::abs(ln) >= options.least_change; });
  if (!changed) return not_learned("nothing has changed");
  return lesson;
}

ClearReference changed_reference(const ClearReference& reference, std::span<const double> ln_change,
                                 TimePoint now) {
  ClearReference changed = reference;
  for (size_t j = 0; j < ln_change.size(); ++j) {
    if (ln_change[j] == 0) continue;
    const double factor = std::exp(ln_change[j]);
    changed.lamps[j].strength *= factor;
    changed.lamps[j].ln_relearned += ln_change[j];
    changed.lamps[j].relearned_utc = now;
    if (changed.catalogue[j].core_flux) *changed.catalogue[j].core_flux *= factor;
  }
  changed.scene = std::make_shared<const Scene>(reference.scene->with_strengths(ln_change));
  return changed;
}

namespace {

std::chrono::milliseconds noon_of(std::optional<double> longitude_deg) {
  const double hours = 12 - longitude_deg.value_or(0.0) / 15;
  return std::chrono::duration_cast<std::chrono::milliseconds>(Hours(hours));
}

}  // namespace

std::int64_t night_number(TimePoint time, std::optional<double> longitude_deg) {
  return std::chrono::floor<std::chrono::days>(time - noon_of(longitude_deg)).time_since_epoch().count();
}

TimePoint night_begin(std::int64_t number, std::optional<double> longitude_deg) {
  return TimePoint(std::chrono::sys_days(std::chrono::days(number))) + noon_of(longitude_deg);
}

}  // namespace lampglow::inference
