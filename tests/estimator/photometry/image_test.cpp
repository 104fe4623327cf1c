// A picture's memory: large blocks come in large pages, and hold what they were told to.
#include "estimator/photometry/image.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

namespace lampglow {
namespace {

TEST(Image, IsFilledWhateverItsSize) {
  // Small; large; large and with a rest of more than half a page.
  for (const int width : {3, 1001, 1520}) {
    { Image<float> used(width, 1008, 7.0F); }  // so that fresh memory need not be zero
    const Image<float> zero(width, 1008);
    EXPECT_EQ(std::ranges::count(zero.pixels, 0.0F), static_cast<std::ptrdiff_t>(width) * 1008);
    const Image<float> copy = Image<float>(width, 1008, 2.5F);
    EXPECT_EQ(std::ranges::count(copy.pixels, 2.5F), static_cast<std::ptrdiff_t>(width) * 1008);
  }
}

TEST(Image, LargeOnesBeginWithALargePage) {
  const auto at = [](const Image<std::uint16_t>& image) {
    return reinterpret_cast<std::uintptr_t>(image.pixels.data());
  };
  EXPECT_EQ(at(Image<std::uint16_t>::unfilled(1520, 1008)) % (2 << 20), 0U);
  const Image<std::uint16_t> odd = Image<std::uint16_t>::unfilled(1021, 1013);
  EXPECT_EQ(odd.pixels.size(), 1021U * 1013U);
  EXPECT_EQ(at(odd) % (2 << 20), 0U);
}

}  // namespace
}  // namespace lampglow
