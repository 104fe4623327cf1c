// Hot pixels: single pixels that shine by themselves. A lamp is blurred by the lens, a hot pixel is not; and
// it stays on its place of the sensor when the camera shakes.
#pragma once

#include <compare>
#include <map>
#include <vector>

#include "estimator/photometry/image.h"

namespace lampglow::photometry {

struct PixelIndex {
  int column = 0;
  int row = 0;
  auto operator<=>(const PixelIndex&) const = default;  // NOLINT(modernize-use-nullptr): clang-tidy 14 errs
};

struct HotPixelOptions {
  double threshold_sigma = 8;  // how far above its surroundings
  // The most that its four neighbours may rise above the surroundings in the mean, as part of the pixel's own
  // rise. A lamp of point spread sigma 0.5 px in a pixel's middle has 0.23, any wider or elsewhere more.
  double neighbour_part = 0.15;
};

// Hot pixels of one frame, row by row. `radiance` and `variance` are of the same size; a saturated pixel
// counts with the value it is clipped at.
std::vector<PixelIndex> find_hot_pixels(const Image<float>& radiance, const Image<float>& variance,
                                        const HotPixelOptions& options = {});

// Learns the sensor's hot pixels from the single-frame finds of many frames.
class HotPixelLearner {
 public:
  void add(const std::vector<PixelIndex>& found);
  int frames() const { return frames_; }
  // Those found in at least this part of the frames, and in at least two.
  std::vector<PixelIndex> map(double least_part = 0.5) const;

 private:
  std::map<PixelIndex, int> count_;
  int frames_ = 0;
};

}  // namespace lampglow::photometry
