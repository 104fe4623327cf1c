// What nights may and may not teach, from hand-made results of frames. (Against counted photons the whole of
// it is tested by replaying simulated nights: tests/system/relearning.)
#include "estimator/inference/relearn.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numeric>
#include <random>

#include "estimator/inference/relearner.h"
#include "tests/estimator/inference/small_reference.h"

namespace lampglow::inference {
namespace {

using std::chrono::minutes;

const TimePoint kEvening = parse_time_utc("2026-01-15T18:00:00Z").value();

// A frame that says "visibility above mor_low_m" and sees each lamp at exp(ln_ratio(distance)) of its
// reference.
FrameResult frame(TimePoint time, double mor_low_m, const std::function<double(double)>& ln_ratio) {
  FrameResult result;
  Observation& o = result.observation;
  o.time_utc = time;
  o.method = Method::glow;
  o.limit = Limit::above;
  o.extinction_per_m = kMorTimesExtinction / mor_low_m;
  o.quality.set(Quality::limit_above);
  for (size_t j = 0; j < std::size(kDistances_m); ++j) {
    LampFit lamp;
    lamp.id = "L" + std::to_string(j + 1);
    lamp.state = LampState::seen;
    lamp.strength_ratio = std::exp(ln_ratio(kDistances_m[j]));
    result.lamps.push_back(lamp);
  }
  return result;
}

using Frames = std::vector<FrameResult>;

// A night of a frame every ten minutes for `hours`.
Frames night(double hours, double mor_low_m, const std::function<double(double)>& ln_ratio) {
  Frames frames;
  for (int i = 0; i <= hours * 6; ++i)
    frames.push_back(frame(kEvening + i * minutes(10), mor_low_m, ln_ratio));
  return frames;
}

Lesson lesson_of(const Frames& frames, const RelearnOptions& options = {}) {
  const ClearReference known = reference();
  std::vector<NightFrame> night;
  for (const FrameResult& result : frames)
    if (auto seen = night_frame(result, known, options)) night.push_back(*seen);
  return learn_from_night(night, known, options);
}

const auto dirty = [](double) { return std::log(0.9); };

TEST(Relearn, AClearNightBehindADirtyWindowMovesAllLampsByPartOfIt) {
  const RelearnOptions options;
  const Lesson lesson = lesson_of(night(6, 15e3, dirty));
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_EQ(lesson.frames, 37);
  EXPECT_NEAR(lesson.hours, 6, 1e-9);
  EXPECT_NEAR(lesson.lowest_mor_m, 15e3, 1);
  EXPECT_NEAR(lesson.ln_common, std::log(0.9), 1e-9);
  ASSERT_EQ(lesson.ln_step.size(), 6U);
  for (const double step : lesson.ln_step) EXPECT_NEAR(step, options.step_part * std::log(0.9), 1e-9);
}

TEST(Relearn, NoNightMovesMoreThanTheCap) {
  const Lesson lesson = lesson_of(night(6, 15e3, [](double) { return std::log(0.7); }));
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  for (const double step : lesson.ln_step) EXPECT_DOUBLE_EQ(step, -RelearnOptions().step_cap);
}

// Thin haze that the fit took for weaker lamps: whatever goes with distance is no lesson.
TEST(Relearn, WhatGoesWithDistanceIsNeverLearned) {
  const double haze_per_m = kMorTimesExtinction / 12e3;
  const Lesson lesson = lesson_of(night(6, 8e3, [&](double distance_m) { return -haze_per_m * distance_m; }));
  EXPECT_FALSE(lesson.learned());
  EXPECT_NEAR(lesson.slope_per_m, -haze_per_m, 1e-9);
  for (const double step : lesson.ln_step) EXPECT_NEAR(step, 0, 1e-9);
}

TEST(Relearn, FadingAsInAirThatIsNotClearRefusesTheWholeNight) {
  const double fog_per_m = 1.1 * kMorTimesExtinction / RelearnOptions().clear_mor_m;
  const RelearnOptions wide{.usual_ln = 2};
  const Lesson lesson =
      lesson_of(night(6, 8e3, [&](double d) { return std::log(0.9) - fog_per_m * d; }), wide);
  EXPECT_EQ(lesson.why_not, "lamps are weaker with distance, as fog makes them");
}

TEST(Relearn, ASingleFrameOrAShortSpellTeachesNothing) {
  EXPECT_FALSE(lesson_of(night(0, 20e3, dirty)).learned());
  EXPECT_FALSE(lesson_of(night(1.5, 20e3, dirty)).learned());
  EXPECT_TRUE(lesson_of(night(2.5, 20e3, dirty)).learned());
}

TEST(Relearn, DoubtBreaksTheNight) {
  for (const Quality doubt : {Quality::not_registered, Quality::automatic_exposure, Quality::few_lights,
                              Quality::fit_not_converged}) {
    Frames frames = night(3, 20e3, dirty);
    frames[9].observation.quality.set(doubt);  // in its middle: no two hours on either side
    EXPECT_FALSE(lesson_of(frames).learned());
  }
  Frames car_passes = night(3, 20e3, dirty);
  car_passes[9].observation.quality.set(Quality::poor_fit);
  for (LampFit& lamp : car_passes[9].lamps) lamp.strength_ratio = 5;
  EXPECT_TRUE(lesson_of(car_passes).learned()) << "its bound holds; its strengths are not taken";
  Frames fog_in_between = night(3, 20e3, dirty);
  fog_in_between[9].observation.extinction_per_m = kMorTimesExtinction / 3000;
  EXPECT_FALSE(lesson_of(fog_in_between).learned());
  Frames droplets = night(3, 20e3, dirty);
  droplets[9].observation.q_low = 0.82;
  EXPECT_FALSE(lesson_of(droplets).learned());
}

// Half an hour before fog is not taken, though it looked clear.
TEST(Relearn, KeepsAwayFromFog) {
  Frames frames = night(4, 20e3, dirty);
  Frames fog = night(2, 500, dirty);
  for (FrameResult& result : fog) result.observation.time_utc += minutes(250);
  frames.insert(frames.end(), fog.begin(), fog.end());
  const Lesson lesson = lesson_of(frames);
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_EQ(lesson.frames, 23);  // 18:00 to 21:40; fog comes at 22:10
}

TEST(Relearn, ALampThatIsDimmedOrDoesNotAgreeIsLeftOut) {
  Frames frames = night(6, 15e3, dirty);
  for (FrameResult& result : frames) {
    result.lamps[0].strength_ratio = 0.45;  // at half power
    result.lamps[2].strength_ratio = 0.7;   // alone in it
  }
  const Lesson lesson = lesson_of(frames);
  ASSERT_TRUE(lesson.learned()) << lesson.why_not;
  EXPECT_EQ(lesson.lamps, 3);
  EXPECT_EQ(lesson.left_out, std::vector<std::string>{"L3"});
  for (const double step : lesson.ln_step) EXPECT_NEAR(step, 0.4 * std::log(0.9), 1e-9);  // the window's
}

TEST(Relearn, FewLampsOrNoReachTeachNothing) {
  Frames frames = night(6, 15e3, dirty);
  for (FrameResult& result : frames) result.lamps.resize(2);
  EXPECT_FALSE(lesson_of(frames).learned());
  EXPECT_FALSE(lesson_of(night(6, 15e3, dirty), {.least_reach = 30}).learned());
}

TEST(Relearn, TheChangedReferenceHasSceneAndCatalogueToMatch) {
  const ClearReference before = reference();
  const std::vector<double> change{-0.1, 0, 0.05, 0, 0, 0};
  const ClearReference after = changed_reference(before, change, kEvening);
  for (size_t j = 0; j < change.size(); ++j) {
    EXPECT_NEAR(after.lamps[j].strength, before.lamps[j].strength * std::exp(change[j]), 1e-6);
    EXPECT_NEAR(after.scene->lamps()[j].ln_strength, before.scene->lamps()[j].ln_strength + change[j], 1e-12);
    EXPECT_NEAR(*after.catalogue[j].core_flux, *before.catalogue[j].core_flux * std::exp(change[j]), 1e-6);
    EXPECT_EQ(after.lamps[j].relearned_utc.has_value(), change[j] != 0);
  }
  EXPECT_EQ(before.scene->lamps()[0].ln_strength, 10);  // others still look at it
}

TEST(Relearn, NightsEndAtTheMeanSunsNoon) {
  const auto number = [](const char* time, std::optional<double> longitude_deg) {
    return night_number(parse_time_utc(time).value(), longitude_deg);
  };
  EXPECT_EQ(number("2026-01-15T12:00:00Z", {}), number("2026-01-16T11:59:59Z", {}));
  EXPECT_EQ(number("2026-01-15T12:00:00Z", {}) + 1, number("2026-01-16T12:00:00Z", {}));
  EXPECT_EQ(number("2026-01-15T11:59:59Z", 15), number("2026-01-15T11:00:00Z", 15));  // noon is at 11:00
  EXPECT_EQ(number("2026-01-15T10:59:59Z", 15) + 1, number("2026-01-15T11:00:00Z", 15));
  EXPECT_EQ(night_begin(number("2026-01-15T23:00:00Z", 15), 15), parse_time_utc("2026-01-15T11:00:00Z"));
}

// A week of fog that thickens slowly, and one of thin haze: frames as the fit gives them where its priors
// take a third of the fading for weaker lamps. Night after night against what was learned before.
TEST(Relearner, FogThatThickensOverAWeekLeavesTheReferenceAsItIs) {
  const ClearReference before = reference();
  Relearner relearner(before, {}, 5.0);
  for (int day = 0; day < 7; ++day) {
    for (int i = 0; i < 60; ++i) {
      const double mor_m = 900 * std::exp(-(day + i / 60.0) / 3);
      const double taken_for_lamps = kMorTimesExtinction / mor_m / 3;
      relearner.add(frame(kEvening + std::chrono::days(day) + i * minutes(10), mor_m * 0.9,
                          [&](double d) { return -taken_for_lamps * d; }));
    }
    const auto settled = relearner.settle();
    ASSERT_TRUE(settled);
    EXPECT_FALSE(settled->lesson.learned());
  }
  for (size_t j = 0; j < before.lamps.size(); ++j) {
    EXPECT_EQ(relearner.reference().lamps[j].strength, before.lamps[j].strength);
    EXPECT_FALSE(relearner.reference().lamps[j].relearned_utc);
  }
}

TEST(Relearner, FollowsAgeingLampsWithinAFewNightsAndThenRests) {
  Relearner relearner(reference(), {}, 5.0);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  double lost = 0;
  for (int day = 0; day < 12; ++day) {
    lost += day < 6 ? 0.03 : 0;
    const ClearReference now = relearner.reference();
    for (int i = 0; i < 40; ++i) {
      const TimePoint time = kEvening + std::chrono::days(day) + i * minutes(10);
      ASSERT_FALSE(relearner.is_over(time));
      FrameResult result = frame(time, 15e3, [](double) { return 0.0; });
      for (size_t j = 0; j < result.lamps.size(); ++j)
        result.lamps[j].strength_ratio = std::exp(-lost - now.lamps[j].ln_relearned + 0.05 * normal(random));
      relearner.add(result);
    }
    EXPECT_TRUE(relearner.is_over(kEvening + std::chrono::days(day + 1)));
    const auto settled = relearner.settle();
    ASSERT_TRUE(settled);
    EXPECT_EQ(settled->valid_from, night_begin(night_number(kEvening, 5.0) + day + 1, 5.0));
  }
  for (const ReferenceLamp& lamp : relearner.reference().lamps) EXPECT_NEAR(lamp.ln_relearned, -lost, 0.03);
}

}  // namespace
}  // namespace lampglow::inference
