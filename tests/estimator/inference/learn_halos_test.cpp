// What haze and fog may and may not teach of the lamps' halos, from hand-made results of frames. (Against
// counted photons the whole of it is tested by replaying simulated nights: tests/system/relearning.)
#include "estimator/inference/learn_halos.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numeric>
#include <random>

#include "estimator/inference/relearner.h"
#include "tests/estimator/inference/small_reference.h"

namespace lampglow::inference {
namespace {

using std::chrono::minutes;

constexpr size_t kLamps = std::size(kDistances_m);
using PerLamp = std::array<double, kLamps>;
const PerLamp kEven{};
// Two cut-off lamps among even ones. Against the mean of all: +0.18 and −0.12.
const PerLamp kMixed{0, 0.3, 0, 0.3, 0};
constexpr double kCutoff = 0.18, kOther = -0.12;

const TimePoint kEvening = parse_time_utc("2026-01-15T18:00:00Z").value();

// A frame of haze or fog whose picture says this of each lamp's halo.
FrameResult frame(const PerLamp& ln_halo, double sigma = 0.04) {
  FrameResult result;
  result.observation.time_utc = kEvening;
  result.observation.method = Method::glow;
  result.observation.extinction_per_m = kMorTimesExtinction / 800;
  result.observation.q = 0.87;
  for (size_t j = 0; j < kLamps; ++j) {
    LampFit lamp;
    lamp.id = "L" + std::to_string(j + 1);
    lamp.state = LampState::seen;
    lamp.strength_ratio = 1.05;
    lamp.ln_halo = ln_halo[j];
    lamp.ln_halo_sigma = sigma;
    result.lamps.push_back(lamp);
  }
  return result;
}

HaloLesson lesson_of(const std::vector<FrameResult>& results, const HaloOptions& options = {},
                     const ClearReference& known = reference()) {
  std::vector<HaloFrame> frames;
  for (const FrameResult& result : results)
    if (auto told = halo_frame(result, known, options)) frames.push_back(*told);
  return learn_halos(frames, known, options);
}

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

TEST(LearnHalos, FogTeachesPartOfTheDifference) {
  const HaloOptions slow{.step_part = 0.25, .step_cap = 1};
  const HaloLesson lesson = lesson_of(std::vector(8, frame(kMixed)), slow);
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_EQ(lesson.frames, 8);
  ASSERT_EQ(lesson.ln_step.size(), kLamps + 1);
  for (size_t j = 0; j < kLamps; ++j)
    EXPECT_NEAR(lesson.ln_step[j], 0.25 * (j % 2 == 1 ? kCutoff : kOther), 1e-9);
  EXPECT_EQ(lesson.ln_step.back(), 0) << "a light in no catalogue";
}

TEST(LearnHalos, WhatAllLampsShareIsNeverLearned) {
  const PerLamp stronger{0.2, 0.2, 0.2, 0.2, 0.2};
  EXPECT_FALSE(lesson_of(std::vector(8, frame(stronger))).learned());
  // Also where it differs from frame to frame, and where a part of the lamps is told in each.
  std::vector<FrameResult> frames;
  for (int i = 0; i < 20; ++i) {
    PerLamp shared;
    for (size_t j = 0; j < kLamps; ++j) shared[j] = kMixed[j] + 0.3 * std::sin(i);
    frames.push_back(frame(shared));
    if (i % 4 == 0) frames.back().lamps[4].ln_halo.reset();
  }
  const HaloLesson lesson = lesson_of(frames);
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_NEAR(sum(lesson.ln_step), 0, 1e-12);
  EXPECT_GT(lesson.ln_step[1], 0.02);
  EXPECT_LT(lesson.ln_step[0], -0.01);
}

TEST(LearnHalos, AWrongFrameDoesNotMatter) {
  std::vector<FrameResult> frames(9, frame(kMixed));
  const HaloLesson right = lesson_of(frames);
  frames[4] = frame({-2, 0.3, 1.5, -1, 0});
  const HaloLesson with_one = lesson_of(frames);
  ASSERT_TRUE(with_one.learned()) << with_one.why_not;
  for (size_t j = 0; j < kLamps; ++j) EXPECT_NEAR(with_one.ln_step[j], right.ln_step[j], 1e-9);
}

TEST(LearnHalos, ClearNightsLimitsAndDoubtTeachNothing) {
  const std::vector<FrameResult> good(8, frame(kMixed));
  ASSERT_TRUE(lesson_of(good).learned());
  EXPECT_FALSE(lesson_of(std::vector(8, frame(kMixed, 0.3))).learned()) << "clear air: no halo to speak of";
  EXPECT_FALSE(lesson_of(std::vector(4, frame(kMixed))).learned()) << "too few";
  const auto spoilt = [&](const auto& spoil) {
    std::vector<FrameResult> frames = good;
    for (FrameResult& result : frames) spoil(result);
    return lesson_of(frames).learned();
  };
  for (const Quality doubt : {Quality::not_registered, Quality::automatic_exposure, Quality::few_lights,
                              Quality::fit_not_converged, Quality::poor_fit})
    EXPECT_FALSE(spoilt([&](FrameResult& r) { r.observation.quality.set(doubt); }));
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.observation.limit = Limit::above; }));
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.observation.limit = Limit::below; }));
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.observation.method = Method::contrast; }));
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.observation.q = 0.95; })) << "rain scatters forward";
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.observation.q.reset(); }));
  EXPECT_FALSE(spoilt([](FrameResult& r) { r.lamps.resize(2); })) << "two lamps have no mean to differ from";
}

TEST(LearnHalos, ADimmedOrFadedLampIsNotTaken) {
  std::vector<FrameResult> frames(8, frame(kMixed));
  for (FrameResult& result : frames) {
    result.lamps[1].strength_ratio = 0.5;
    result.lamps[4].state = LampState::faded;
    result.lamps[4].ln_halo = 5;
  }
  const HaloLesson lesson = lesson_of(frames);
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_EQ(lesson.ln_step[1], 0);
  EXPECT_EQ(lesson.ln_step[4], 0);
  EXPECT_GT(lesson.ln_step[3], 0);
}

// Errors of one night's frames are those of its air: even lamps must not wander by them.
TEST(LearnHalos, EvenLampsThatScatterTeachNothing) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  for (int night = 0; night < 50; ++night) {
    PerLamp of_the_night;
    for (double& ln : of_the_night) ln = 0.02 * normal(random);
    std::vector<FrameResult> frames;
    for (int i = 0; i < 20; ++i) {
      PerLamp now = of_the_night;
      for (double& ln : now) ln += 0.08 * normal(random);
      frames.push_back(frame(now));
    }
    EXPECT_FALSE(lesson_of(frames).learned()) << night;
  }
}

TEST(LearnHalos, NoNightMovesMoreThanTheCapAndNoLampGoesTooFar) {
  const HaloOptions options;
  ClearReference known = reference();
  const std::vector<FrameResult> frames(8, frame({0, 9, 0, 9, 0}));
  const HaloLesson first = lesson_of(frames, options, known);
  ASSERT_TRUE(first.learned()) << first.why_not;
  for (size_t j = 0; j < kLamps; ++j) {  // ±0.1, and what they share, 2/5 − 3/5 of it, off
    EXPECT_NEAR(first.ln_step[j], (j % 2 == 1 ? 1.2 : -0.8) * options.step_cap, 1e-12);
  }
  for (int night = 0; night < 100; ++night) {
    const HaloLesson lesson = lesson_of(frames, options, known);
    if (lesson.learned()) known = with_halos(known, lesson.ln_step, kEvening);
  }
  for (size_t j = 0; j < kLamps; ++j)
    EXPECT_LT(std::abs(known.lamps[j].ln_halo), 1.25 * options.farthest_ln) << j;
}

TEST(LearnHalos, TheChangedReferenceHasASceneToMatch) {
  const ClearReference before = reference();
  const std::vector<double> change{-0.1, 0, 0.05, 0, 0, 0};
  const ClearReference after = with_halos(before, change, kEvening);
  for (size_t j = 0; j < change.size(); ++j) {
    EXPECT_EQ(after.lamps[j].ln_halo, change[j]);
    EXPECT_EQ(after.scene->lamps()[j].ln_halo, change[j]);
    EXPECT_EQ(after.lamps[j].halo_utc.has_value(), change[j] != 0);
    EXPECT_EQ(after.lamps[j].strength, before.lamps[j].strength);
  }
  EXPECT_EQ(before.scene->lamps()[0].ln_halo, 0) << "others still look at it";
}

// Nights of fog over lamps of two kinds, each frame measured against what was learned before.
TEST(LearnHalos, NightsOfFogLearnTheDifferenceAndThenRest) {
  Relearner relearner(reference(), {}, 5.0);
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  int taught = 0;
  for (int day = 0; day < 14; ++day) {
    const ClearReference now = relearner.reference();
    for (int i = 0; i < 30; ++i) {
      PerLamp seen;
      for (size_t j = 0; j < kLamps; ++j) seen[j] = kMixed[j] - now.lamps[j].ln_halo + 0.06 * normal(random);
      FrameResult result = frame(seen);
      result.observation.time_utc = kEvening + std::chrono::days(day) + i * minutes(10);
      relearner.add(result);
    }
    const auto settled = relearner.settle();
    ASSERT_TRUE(settled);
    EXPECT_FALSE(settled->lesson.learned()) << "fog teaches no strengths";
    taught += settled->learned();
  }
  EXPECT_GE(taught, 2);
  EXPECT_LE(taught, 8);
  // A difference within its error, of 3 · 0.03 and more, is left.
  const auto& lamps = relearner.reference().lamps;
  for (size_t j = 0; j < kLamps; ++j)
    EXPECT_NEAR(lamps[j].ln_halo, j % 2 == 1 ? kCutoff : kOther, 0.11) << lamps[j].id;
  EXPECT_GT(lamps[1].ln_halo - lamps[0].ln_halo, 0.1);
  for (const ReferenceLamp& lamp : lamps) EXPECT_EQ(lamp.ln_relearned, 0);
}

}  // namespace
}  // namespace lampglow::inference
