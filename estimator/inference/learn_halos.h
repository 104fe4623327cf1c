// What haze and fog teach of each lamp's halo. Street lights are luminaires: one that sends its light down
// has a stronger halo against its beam than an even lamp, and reads as fog or as larger droplets where the
// fit does not know it. Strengths show in clear nights (relearn.h), halos in the others. Pure functions.
//
// A halo that all lamps share goes with σ, q and the common emission; what differs from lamp to lamp does
// not. So the mean over the lamps is taken off every frame, and off what a night taught: only differences are
// learned, and the sum of ln halo over the lamps stays what it was.
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/inference/reference.h"
#include "estimator/observation.h"

namespace lampglow::inference {

struct HaloOptions {
  double most_q = 0.92;         // drops scatter so nearly forward that a lamp's other sides do not show
  double most_ln_sigma = 0.25;  // a frame that knows a lamp's halo less well says nothing of it
  double usual_ln = 0.45;  // a lamp further off its reference's strength is dimmed, hidden or another one
  int least_lamps = 3;     // of a frame, and of a night
  int least_frames = 5;    // of a night, for each lamp
  double floor_ln_sigma = 0.03;  // of a night's lesson on one lamp: its frames share their air
  double most_error = 0.08;      // the same with the scatter of its frames; more teaches nothing
  double clear_difference = 3;   // times its error: so much must at least one lamp differ
  double step_part = 0.4;        // of the difference seen, a night
  double step_cap = 0.1;         // of ln halo, before what the steps share is taken off them
  double farthest_ln = 1;        // ln halo is drawn towards nothing beyond ± this
};

// ln of a lamp's halo strength over the reference's, as one frame has it.
struct HaloReading {
  double ln_halo = 0, sigma = 0;
};
// One for each lamp of the reference, against the frame's mean; empty: the frame says nothing of it.
using HaloFrame = std::vector<std::optional<HaloReading>>;

// Empty for frames that teach nothing: clear ones, limits, doubtful ones.
std::optional<HaloFrame> halo_frame(const FrameResult& result, const ClearReference& reference,
                                    const HaloOptions& options);

struct HaloLesson {
  std::string why_not;  // empty if something was learned
  int frames = 0;
  std::vector<double> ln_step;  // one for each lamp of the reference; empty if nothing was learned
  bool learned() const { return why_not.empty() && !ln_step.empty(); }
};
// Frames of one night, all measured against `reference`.
HaloLesson learn_halos(std::span<const HaloFrame> frames, const ClearReference& reference,
                       const HaloOptions& options);

// The reference with ln halo strengths changed by `ln_change` (one for each of its lamps), learned at `now`.
ClearReference with_halos(const ClearReference& reference, std::span<const double> ln_change, TimePoint now);

}  // namespace lampglow::inference
