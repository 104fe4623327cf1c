// What storage keeps of a reference brings it back, strengths and halos alike.
#include "daemon/replay/reference_log.h"

#include <gtest/gtest.h>

#include "tests/estimator/inference/small_reference.h"

namespace lampglow::daemon {
namespace {

const TimePoint kNoon = parse_time_utc("2026-01-16T12:00:00Z").value();

inference::Relearner::Settled fog_taught(std::vector<double> ln_step) {
  inference::Relearner::Settled settled;
  settled.lesson.why_not = "fog";
  settled.lesson.frames = 3;
  settled.halos.frames = 23;
  settled.halos.ln_step = std::move(ln_step);
  settled.valid_from = kNoon;
  return settled;
}

TEST(ReferenceLog, ARecordBringsBackStrengthsAndHalos) {
  const ClearReference base = inference::reference();
  const std::vector<double> strengths{-0.1, 0, 0.05, 0, 0, -0.02}, halos{0.2, -0.05, 0, -0.15, 0, 0};
  const TimePoint earlier = kNoon - std::chrono::days(3);
  const ClearReference now =
      inference::with_halos(inference::changed_reference(base, strengths, earlier), halos, kNoon);
  const storage::ReferenceRecord record = reference_record(now, fog_taught(halos));
  EXPECT_EQ(record.origin, storage::ReferenceOrigin::relearned);
  EXPECT_EQ(record.halo_frames, 23);
  EXPECT_EQ(record.frames, 0) << "fog taught no strength";
  EXPECT_FALSE(record.mor_low_m);
  EXPECT_FALSE(record.ln_common);

  const auto back = with_record(base, record);
  ASSERT_TRUE(back);
  for (size_t j = 0; j < halos.size(); ++j) {
    EXPECT_EQ(back->lamps[j].ln_halo, halos[j]);
    EXPECT_EQ(back->scene->lamps()[j].ln_halo, halos[j]);
    EXPECT_EQ(back->lamps[j].halo_utc, now.lamps[j].halo_utc);
    EXPECT_EQ(back->lamps[j].ln_relearned, strengths[j]);
    EXPECT_EQ(back->scene->lamps()[j].ln_strength, now.scene->lamps()[j].ln_strength);
    EXPECT_EQ(back->lamps[j].relearned_utc, now.lamps[j].relearned_utc);
  }
  storage::ReferenceRecord of_others = record;
  of_others.base_utc = kNoon;
  EXPECT_FALSE(with_record(base, of_others)) << "other clear brackets";
}

TEST(ReferenceLog, TheEventSaysWhatWasLearned) {
  const std::vector<double> step{0.1, -0.1, 0, 0, 0, 0};
  const ClearReference now = inference::with_halos(inference::reference(), step, kNoon);
  const std::string text = lesson_text(now, fog_taught(step));
  EXPECT_EQ(text,
            "halo strengths relearned from 23 frames of haze and fog; L1 1.000 to 1.105, L2 1.000 to 0.905.");
}

}  // namespace
}  // namespace lampglow::daemon
