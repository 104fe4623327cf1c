#include "estimator/inference/combine.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lampglow::inference {
namespace {

Observation value(Method method, double mor_m, double ln_sd) {
  Observation o;
  o.method = method;
  o.extinction_per_m = kMorTimesExtinction / mor_m;
  o.extinction_low_per_m = *o.extinction_per_m * std::exp(-1.96 * ln_sd);
  o.extinction_high_per_m = *o.extinction_per_m * std::exp(1.96 * ln_sd);
  return o;
}

Observation above(Method method, double mor_m) {
  Observation o;
  o.method = method;
  o.limit = Limit::above;
  o.extinction_per_m = o.extinction_high_per_m = kMorTimesExtinction / mor_m;
  return o;
}

TEST(Combine, ByDayTheContrastByNightTheGlow) {
  const Observation glow = value(Method::glow, 500, 0.1), contrast = value(Method::contrast, 700, 0.1);
  EXPECT_NEAR(*combine(glow, contrast, 20).mor_m(), 700, 1e-6);
  EXPECT_NEAR(*combine(glow, contrast, -20).mor_m(), 500, 1e-6);
  EXPECT_EQ(combine(glow, contrast, 20).method, Method::contrast);
  EXPECT_EQ(combine(glow, contrast, -20).method, Method::glow);
}

TEST(Combine, NoStepFromNightToDay) {
  const Observation glow = value(Method::glow, 500, 0.1), contrast = value(Method::contrast, 700, 0.15);
  double last = 500;
  for (int i = 0; i <= 200; ++i) {
    const double altitude = -10 + 0.1 * i;
    const Observation o = combine(glow, contrast, altitude);
    EXPECT_LT(std::abs(std::log(*o.mor_m() / last)), 0.02) << altitude;
    EXPECT_LE(*o.mor_low_m(), *o.mor_m());
    EXPECT_GE(*o.mor_high_m(), *o.mor_m());
    last = *o.mor_m();
  }
}

TEST(Combine, AgreementNarrowsAndDisagreementWidens) {
  const auto width = [](const Observation& o) { return std::log(*o.mor_high_m() / *o.mor_low_m()); };
  const Observation a = value(Method::glow, 1000, 0.1);
  EXPECT_LT(width(combine(a, value(Method::contrast, 1000, 0.1), std::nullopt)), width(a));
  EXPECT_GT(width(combine(a, value(Method::contrast, 3000, 0.1), std::nullopt)), width(a));
}

TEST(Combine, LimitsGiveWayToValuesThatTheyAllow) {
  EXPECT_EQ(combine(above(Method::glow, 2000), value(Method::contrast, 5000, 0.1), -2).limit, Limit::none);
  EXPECT_EQ(combine(value(Method::glow, 5000, 0.1), above(Method::contrast, 2000), -2).limit, Limit::none);
  // By day "above 8 km" of the targets is not undone by what lamps in daylight seem to say.
  const Observation o = combine(value(Method::glow, 500, 0.1), above(Method::contrast, 8000), 3);
  EXPECT_EQ(o.limit, Limit::above);
}

TEST(Combine, ALimitOfAPoorFitUndoesNoValueThatFits) {
  Observation limit = above(Method::glow, 8000), contrast = value(Method::contrast, 500, 0.1);
  EXPECT_EQ(combine(limit, contrast, -4).limit, Limit::above);
  limit.quality.set(Quality::poor_fit);
  EXPECT_NEAR(*combine(limit, contrast, -4).mor_m(), 500, 1e-6);
  EXPECT_TRUE(combine(limit, contrast, -4).quality.has(Quality::poor_fit));
  contrast.quality.set(Quality::poor_fit);
  EXPECT_EQ(combine(limit, contrast, -4).limit, Limit::above);
}

TEST(Combine, OnlyTheAnswersOwnLimitIsFlagged) {
  Observation limit = above(Method::glow, 2000);
  limit.quality.set(Quality::limit_above);
  EXPECT_FALSE(combine(limit, value(Method::contrast, 5000, 0.1), -2).quality.has(Quality::limit_above));
  EXPECT_TRUE(combine(limit, above(Method::contrast, 1000), -2).quality.has(Quality::limit_above));
}

TEST(Combine, OfTwoLimitsTheTighterHolds) {
  EXPECT_NEAR(*combine(above(Method::glow, 2000), above(Method::contrast, 9000), -1).mor_m(), 9000, 1e-6);
}

TEST(Combine, NothingFromNothingAndFlagsOfBoth) {
  Observation glow, contrast;
  glow.quality.set(Quality::no_reference);
  contrast.quality.set(Quality::low_sun);
  const Observation o = combine(glow, contrast, -1);
  EXPECT_FALSE(o.extinction_per_m);
  EXPECT_TRUE(o.quality.has(Quality::no_reference));
  EXPECT_TRUE(o.quality.has(Quality::low_sun));
}

}  // namespace
}  // namespace lampglow::inference
