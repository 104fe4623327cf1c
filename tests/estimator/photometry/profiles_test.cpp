#include "estimator/photometry/profiles.h"

#include <gmock/gmock.h>

#include <stdexcept>

namespace lampglow::photometry {
namespace {

Camera small_camera() {
  Camera camera;
  camera.width_px = 40;
  camera.height_px = 20;
  camera.principal_x_px = 20;
  camera.principal_y_px = 10;
  camera.focal_length_px = 30;
  return camera;
}

// The last ring of the last lamp still has its own number, and one lamp more is refused in words.
TEST(RingMap, HoldsAsManyRingsAsItHasNumbers) {
  const RingOptions options{.rings = 40};
  std::vector<RingCentre> centres(kMaxRings / 40, RingCentre{10.5, 10.5, 1e-6});
  ASSERT_EQ(centres.size(), 819U);
  centres.back() = {30.5, 10.5, 1.0};
  const RingMap map = make_ring_map(small_camera(), centres, options);
  EXPECT_EQ(map.rings.size(), 32'760U);
  EXPECT_EQ(map.ring_of_pixel.at(30, 10), 818 * 40);
  centres.emplace_back();
  try {
    make_ring_map(small_camera(), centres, options);
    FAIL() << "820 lamps were taken";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "820 lamps of 40 rings each: expected at most 32767 rings");
  }
}

}  // namespace
}  // namespace lampglow::photometry
