// The clear reference in service: lamps age and windows get dirty, slowly; its strengths follow, from whole
// clear nights alone and never from fog (what fog teaches: learn_halos.h). Pure functions.
//
// Fog and a dirty window differ in two ways: fog dims far lamps more than near ones, and it glows. So a night
// teaches only while every frame's 95 % bound on visibility is far beyond what matters, and even then
// whatever goes with distance is taken off the lesson: a weighted line ln ratio = a + b·distance is fitted
// over the lamps, and −b, which is an extinction, is never learned. What is left is what all lamps share (a)
// and each lamp's own.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/inference/learn_halos.h"
#include "estimator/inference/reference.h"
#include "estimator/observation.h"

namespace lampglow::inference {

struct RelearnOptions {
  double clear_mor_m = 6000;    // every teaching frame's visibility is above this by its 95 % bound
  double least_hours = 2;       // clear without a break
  int least_frames = 8;         // in that time
  double longest_gap_h = 1.25;  // a longer one is a break
  double margin_h = 0.5;        // nothing is taken from so near to a frame that was not clear
  double step_part = 0.4;       // of the difference seen, a night
  double step_cap = 0.05;       // most that a night changes ln strength by
  double usual_ln = 0.45;       // a lamp further off its reference is dimmed, hidden or another one
  double least_part =
      0.3;                 // of the frames in which a lamp must be seen at its usual power; many dim at night
  int least_lamps = 3;     // that agree, at different distances:
  double least_reach = 2;  // the farthest over the nearest of them
  double agree_ln = 0.15;  // lamps further off the line than this do not agree, and learn nothing
  double least_change = 0.002;  // of ln strength; less is not worth an entry
  HaloOptions halos{};          // what the nights that are not clear teach
};

// What one frame of the night says. Frames that say nothing (daylight, no picture, no fit) have none.
struct NightFrame {
  TimePoint time_utc{};
  std::optional<double> clear_mor_m;  // 95 % lower bound of visibility; empty: not clear beyond doubt
  std::vector<std::optional<double>> ln_ratio;  // of each lamp of the reference, fitted over its reference
};
std::optional<NightFrame> night_frame(const FrameResult& result, const ClearReference& reference,
                                      const RelearnOptions& options);

// What a night taught. `why_not` is empty if it taught something; `ln_step` then has an entry for each lamp
// of the reference: those that were not seen at their usual power follow what all share.
struct Lesson {
  std::string why_not;
  int frames = 0;
  double hours = 0;
  double lowest_mor_m = 0;  // the lowest of the teaching frames' lower bounds
  double ln_common = 0;     // what all lamps share, over the reference; not yet weakened to a step
  double slope_per_m = 0;   // what went with distance: seen, and not learned
  int lamps = 0;            // that agreed
  std::vector<double> ln_step;
  std::vector<std::string> left_out;  // lamps that burned, but did not agree
  bool learned() const { return why_not.empty(); }
};
// Frames of one night in the order of time, all measured against `reference`.
Lesson learn_from_night(std::span<const NightFrame> frames, const ClearReference& reference,
                        const RelearnOptions& options);

// The reference with ln strengths changed by `ln_change` (one for each of its lamps), learned at `now`.
ClearReference changed_reference(const ClearReference& reference, std::span<const double> ln_change,
                                 TimePoint now);

// Nights are told apart at noon, of the mean sun where the longitude is known: the same number for all times
// from one noon to the next, ascending.
std::int64_t night_number(TimePoint time, std::optional<double> longitude_deg);
// The noon with which that night began.
TimePoint night_begin(std::int64_t number, std::optional<double> longitude_deg);

}  // namespace lampglow::inference
