// Rain on the window through the real program: `simulate --day --with rain-on-window`, `replay`, and the
// truth of every frame. The simulator's drops are lenses that its rays are traced through; the estimator
// knows nothing of that.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "tests/support/csv_rows.h"
#include "tests/support/run_program.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::simulation {
namespace {

using Rows = std::map<std::string, std::vector<std::string>>;

struct Counts {
  int frames = 0, held = 0;  // truth within the bounds, or on the limit's right side
  int wet = 0, flagged = 0;  // drops on more than 0.15 of the window, and not lost in fog
  int dry = 0, falsely_flagged = 0;
};

double number_or(const std::string& text, double otherwise) {
  return text.empty() ? otherwise : std::stod(text);
}

// Columns of replay's CSV: 1 mor_m, 2 mor_low_m, 3 mor_high_m, 4 limit, 12 quality.
bool holds(const std::vector<std::string>& seen, double mor_m) {
  if (seen.at(4) == "above") return mor_m >= std::stod(seen[1]);
  if (seen.at(4) == "below") return mor_m <= std::stod(seen[1]);
  return mor_m >= number_or(seen.at(2), 0) && mor_m <= number_or(seen.at(3), 1e9);
}

void count(const Rows& truth, const Rows& seen, Counts& counts) {
  const auto& head = truth.at("time_utc");
  const auto covered_at =
      static_cast<size_t>(std::find(head.begin(), head.end(), "window_covered") - head.begin());
  for (const auto& [time, row] : truth) {
    if (row.at(1) != "observation") continue;
    const double mor_m = std::stod(row.at(2)), covered = std::stod(row.at(covered_at));
    const auto& frame = seen.at(time);
    const bool flagged = frame.at(12).find("rain_on_window") != std::string::npos;
    ++counts.frames, counts.held += holds(frame, mor_m);
    if (covered > 0.15 && mor_m > 600) ++counts.wet, counts.flagged += flagged;
    if (covered == 0) ++counts.dry, counts.falsely_flagged += flagged;
  }
}

TEST(RainOnWindow, IsFlaggedInWetFramesAloneAndTheBoundsHold) {
  Counts counts;
  for (const int seed : {41, 42, 43}) {
    const test::TemporaryFolder folder;
    const std::string archive = (folder.path() / "day").string(), csv = (folder.path() / "out.csv").string();
    const auto simulated =
        test::run_program({"simulate", archive, "--day", "--with", "rain-on-window", "--seed",
                           std::to_string(seed), "--frames", "30", "--photons", "1000"});
    ASSERT_EQ(simulated.exit_code, 0) << simulated.err;
    const auto replayed = test::run_program({"replay", archive, "--csv", csv});
    ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
    count(test::rows_by_time(test::read_all(archive + "/truth_full.csv")),
          test::rows_by_time(test::read_all(csv)), counts);
  }
  std::printf("flagged %d of %d wet frames, %d of %d dry ones; held %d of %d\n", counts.flagged, counts.wet,
              counts.falsely_flagged, counts.dry, counts.held, counts.frames);
  EXPECT_GE(counts.wet, 12);
  EXPECT_GE(counts.flagged, counts.wet / 2);
  EXPECT_EQ(counts.falsely_flagged, 0);
  EXPECT_GE(counts.held, counts.frames * 85 / 100);
}

}  // namespace
}  // namespace lampglow::simulation
