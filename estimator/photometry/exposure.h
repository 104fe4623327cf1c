// What a camera gives: exposures, grouped to brackets by their time.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimator/photometry/image.h"
#include "estimator/quality.h"
#include "estimator/time.h"

namespace lampglow {

// One exposure: mono (or the green channel of a colour picture), as digital numbers.
struct Exposure {
  std::string name;                  // file name or camera's frame number, for messages
  std::optional<double> exposure_s;  // empty: automatic, unknown
  std::optional<double> gain_db;
  Image<std::uint16_t> pixels;
  bool monochrome = true;  // false: the picture had colour (all channels differ somewhere)
};

enum class FrameRole { observation, clear_reference };

// All exposures of one point in time. Exposures that could not be read are left out and flagged in `quality`.
struct Bracket {
  TimePoint time_utc{};
  FrameRole role = FrameRole::observation;
  std::optional<double> reference_mor_m;  // of a clear_reference, where it is known
  std::vector<Exposure> exposures;        // in any order of exposure_s
  QualityFlags quality;                   // frame_* flags of what went wrong on the way here
  std::string fault;                      // the same in words: file and reason; empty if all is well
};

}  // namespace lampglow
