#include "estimator/photometry/hot_pixels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "tests/estimator/photometry/scene.h"

namespace lampglow::photometry {
namespace {

constexpr int kSize = 256;

struct HotScene {
  Image<double> truth{kSize, kSize, 40.0};
  std::set<PixelIndex> hot;
  std::vector<scene::Lamp> lamps;
};

// 30 hot pixels from faint to bright, 25 lamps down to a point spread of 0.6 px at all sub-pixel places.
HotScene make_scene(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int> place(6, kSize - 7);
  std::uniform_real_distribution<double> part(0, 1);
  HotScene result;
  for (int i = 0; i < 25; ++i) {
    const scene::Lamp lamp{10 + (i % 5) * 50 + part(random), 10 + (i / 5) * 50 + part(random),
                           std::pow(10, 2.6 + 1.5 * part(random)), 0.6 + 0.6 * part(random)};
    result.lamps.push_back(lamp);
    scene::add_lamp(result.truth, lamp);
  }
  while (result.hot.size() < 30) {
    const PixelIndex pixel{place(random), place(random)};
    const bool near_lamp =
        std::any_of(result.lamps.begin(), result.lamps.end(), [&](const scene::Lamp& lamp) {
          return std::hypot(pixel.column + 0.5 - lamp.x_px, pixel.row + 0.5 - lamp.y_px) < 6;
        });
    const bool near_other = std::any_of(result.hot.begin(), result.hot.end(), [&](const PixelIndex& other) {
      return std::hypot(pixel.column - other.column, pixel.row - other.row) < 4;
    });
    if (!near_lamp && !near_other && result.hot.insert(pixel).second)
      result.truth.at(pixel.column, pixel.row) += std::pow(10, 2.3 + 2 * part(random));
  }
  return result;
}

TEST(HotPixels, AreFoundInOneFrameWithoutLosingLamps) {
  int found = 0, missed = 0, wrong = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    std::mt19937_64 random(100 + seed);
    const HotScene scene = make_scene(seed);
    const Camera camera = scene::camera_12_bit(kSize, kSize);
    const RadianceImage image = to_radiance(scene::bracket(scene.truth, camera, {1}, random), camera);
    for (int y = 0; y < kSize; ++y)
      for (int x = 0; x < kSize; ++x)
        if (image.mask.at(x, y) & kHot) ++(scene.hot.count({x, y}) ? found : wrong);
    missed += static_cast<int>(scene.hot.size());
  }
  missed -= found;
  EXPECT_GE(found, 294) << "of 300";  // faint ones may drown
  EXPECT_EQ(wrong, 0) << "pixels of lamps or sky taken for hot";
}

TEST(HotPixels, SaturatedOnesAreFoundTooAndSaturatedLampsAreNot) {
  std::mt19937_64 random(11);
  const Camera camera = scene::camera_12_bit(40, 40);
  Image<double> truth(40, 40, 40.0);
  truth.at(8, 8) = 1e6;
  scene::add_lamp(truth, {25.3, 25.6, 1e6, 0.6});
  const RadianceImage image = to_radiance(scene::bracket(truth, camera, {1}, random), camera);
  EXPECT_TRUE(image.mask.at(8, 8) & kHot);
  EXPECT_EQ(image.mask.at(25, 25), kSaturated);
}

TEST(HotPixels, AreLearnedOverFrames) {
  HotPixelLearner learner;
  learner.add({{1, 1}, {5, 5}});
  EXPECT_TRUE(learner.map().empty()) << "one frame is not enough";
  learner.add({{5, 5}});
  learner.add({{5, 5}, {9, 9}});
  learner.add({{2, 1}});
  EXPECT_THAT(learner.map(), ::testing::ElementsAre(PixelIndex{5, 5}));
  EXPECT_EQ(learner.frames(), 4);
}

}  // namespace
}  // namespace lampglow::photometry
