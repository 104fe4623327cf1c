#include "daemon/sources/checks.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace lampglow::daemon {
namespace {

Image<std::uint16_t> noisy_night(int seed, int width = 64, int height = 48) {
  std::mt19937 random(static_cast<unsigned>(seed));
  Image<std::uint16_t> picture(width, height);
  for (auto& value : picture.pixels) value = static_cast<std::uint16_t>(10 + random() % 7);
  return picture;
}

Bracket bracket_of(Image<std::uint16_t> picture) {
  Bracket bracket;
  bracket.exposures.push_back({"frame 1", {}, {}, std::move(picture), true});
  return bracket;
}

TEST(FaultRegistry, NumbersAndNamesAreUniqueAndGoBothWays) {
  std::set<int> numbers;
  std::set<std::string_view> names;
  for (const FaultInfo& info : fault_registry()) {
    EXPECT_TRUE(numbers.insert(static_cast<int>(info.fault)).second) << info.name;
    EXPECT_TRUE(names.insert(info.name).second) << info.name;
    EXPECT_EQ(parse_fault(info.name), info.fault);
    EXPECT_EQ(to_string(info.fault), info.name);
    EXPECT_FALSE(info.meaning.empty());
    EXPECT_EQ(info.fault == Fault::none, !info.quality) << info.name;
  }
  EXPECT_FALSE(parse_fault("no_such_fault"));
}

TEST(FrameChecks, NightPictureIsGood) {
  FrameChecker checker({.width_px = 64, .height_px = 48});
  for (int i = 0; i < 10; ++i) EXPECT_EQ(checker.check(bracket_of(noisy_night(i))).fault, Fault::none);
}

TEST(FrameChecks, BlackIsOneValueEverywhere) {
  FrameChecker checker({});
  EXPECT_EQ(checker.check(bracket_of(Image<std::uint16_t>(64, 48, 16))).fault, Fault::black);
  auto lamp = Image<std::uint16_t>(64, 48, 0);  // denoised black sky with one lamp: a good picture
  lamp.at(30, 20) = 200;
  EXPECT_EQ(checker.check(bracket_of(lamp)).fault, Fault::none);
}

TEST(FrameChecks, GreyFillOfADecoder) {
  for (const int bit_depth : {8, 12}) {
    FrameChecker checker({.bit_depth = bit_depth});
    auto picture = noisy_night(1);
    const auto grey = static_cast<std::uint16_t>(1 << (bit_depth - 1));
    for (int row = 40; row < 48; ++row)
      for (int column = 0; column < 64; ++column) picture.at(column, row) = grey;
    EXPECT_EQ(checker.check(bracket_of(picture)).fault, Fault::grey);
    picture.at(5, 46) = 10;  // not flat: something real is there
    EXPECT_EQ(checker.check(bracket_of(picture)).fault, Fault::none);
  }
}

TEST(FrameChecks, FrozenAfterTheThirdAndFreeAgain) {
  FrameChecker checker({.frozen_after = 3});
  const auto fault = [&](int seed) { return checker.check(bracket_of(noisy_night(seed))).fault; };
  EXPECT_EQ(fault(1), Fault::none);
  EXPECT_EQ(fault(1), Fault::none);
  EXPECT_EQ(fault(1), Fault::frozen);
  EXPECT_EQ(fault(1), Fault::frozen);
  EXPECT_EQ(fault(2), Fault::none);
}

TEST(FrameChecks, SizeChangedOnceThenCompared) {
  FrameChecker any_size({});
  EXPECT_EQ(any_size.check(bracket_of(noisy_night(1))).fault, Fault::none);
  EXPECT_EQ(any_size.check(bracket_of(noisy_night(2, 32, 24))).fault, Fault::resolution_changed);
  EXPECT_EQ(any_size.check(bracket_of(noisy_night(3, 32, 24))).fault, Fault::none);

  FrameChecker site_size({.width_px = 64, .height_px = 48});
  const CheckResult result = site_size.check(bracket_of(noisy_night(1, 32, 24)));
  EXPECT_EQ(result.fault, Fault::wrong_size);
  EXPECT_EQ(result.message, "the picture is 32x24, the site file says 64x48");
}

}  // namespace
}  // namespace lampglow::daemon
