// Whether a decoded picture can be what the camera saw. Pure functions of the pixels.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "daemon/sources/fault.h"
#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

struct FrameCheckOptions {
  int width_px = 0;  // the site file's; 0: any
  int height_px = 0;
  int bit_depth = 8;
  int frozen_after = 3;  // the same picture so many times running is a fault; 0: never
};

struct CheckResult {
  Fault fault = Fault::none;
  std::string message;
};

// All pixels within one DN: a cap, a dead sensor, a placeholder.
bool is_black(const Image<std::uint16_t>& picture);

// The lowest sixteenth of the picture or more is flat at mid-range (+-4 %): the fill of a JPEG or H.264
// decoder that ran out of data. Nights have flat black, but no flat mid-grey.
bool has_grey_fill(const Image<std::uint16_t>& picture, int bit_depth);

// A camera may accept an exposure, tell it back (uvcvideo remembers what it wrote) and yet expose as it
// likes. Then the longest exposure of a bracket is no brighter than the shortest. Judged only where the
// shortest shows a light and is not bright all over, and the times differ by a factor of 4 or more: there, 2
// % more light are the least.
bool follows_exposure(const Bracket& bracket, int bit_depth);

// FNV-1a, 64 bits, over size and pixels.
std::uint64_t picture_hash(const Image<std::uint16_t>& picture);

// Remembers what it needs of earlier pictures of one camera: size and hash.
class FrameChecker {
 public:
  explicit FrameChecker(FrameCheckOptions options) : options_(options) {}
  // The first fault of the bracket's exposures, in the order: size, black, grey, frozen.
  CheckResult check(const Bracket& bracket);

 private:
  CheckResult check_size(const Exposure& exposure);
  bool is_frozen(const Bracket& bracket);

  FrameCheckOptions options_;
  int last_width_px_ = 0;
  int last_height_px_ = 0;
  std::optional<std::uint64_t> last_hash_;
  int repeats_ = 0;
};

}  // namespace lampglow::daemon
