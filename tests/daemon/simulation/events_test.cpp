// What comes over the station, through the real program: `simulate --day --with …`, `replay`, and the truth
// of every frame. The simulator's drops are lenses that its rays are traced through; the estimator knows
// nothing of that.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iostream>

#include "tests/support/csv_rows.h"
#include "tests/support/run_program.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::simulation {
namespace {

struct EventFrame {
  double mor_m = 0, window_covered = 0;
  bool snow = false, half_lit = false;
  bool valued = false, held = false;
  std::string quality;
  bool flagged(const std::string& flag) const { return quality.find(flag) != std::string::npos; }
};

double number(const std::string& text, double otherwise) {
  return text.empty() ? otherwise : std::stod(text);
}

// The part of the first two targets that the sun shines on; their box's middle lies in shadow or in the sun.
bool half_lit(const std::vector<std::string>& truth, size_t first) {
  for (size_t t = first; t < std::min(first + 2, truth.size()); ++t)
    if (!truth[t].empty() && std::stod(truth[t]) > 0.3 && std::stod(truth[t]) < 0.7) return true;
  return false;
}

std::vector<EventFrame> replayed(const std::string& event, int seed) {
  const test::TemporaryFolder folder;
  const std::string archive = (folder.path() / "day").string(), csv = (folder.path() / "out.csv").string();
  const auto run = [](const std::vector<std::string>& arguments) {
    const auto done = test::run_program(arguments);
    EXPECT_EQ(done.exit_code, 0) << done.err;
  };
  run({"simulate", archive, "--day", "--with", event, "--seed", std::to_string(seed), "--frames", "30",
       "--photons", "1000"});
  run({"replay", archive, "--csv", csv});
  const auto read = [](const std::string& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return test::rows_by_time(text.str());
  };
  auto truth = read(archive + "/truth_full.csv"), seen = read(csv);
  const std::vector<std::string>& head = truth.at("time_utc");
  const auto column = [&](const char* name) {
    return static_cast<size_t>(std::find(head.begin(), head.end(), name) - head.begin());
  };
  const size_t covered = column("window_covered"), snow = column("snow"), lit = column("sunlit_T1");
  std::vector<EventFrame> frames;
  for (auto& [time, row] : truth) {
    if (time == "time_utc" || row.at(1) != "observation") continue;
    const std::vector<std::string>& out = seen.at(time);
    EventFrame frame;
    frame.mor_m = std::stod(row.at(2));
    frame.window_covered = std::stod(row.at(covered));
    frame.snow = row.at(snow) == "1";
    frame.half_lit = half_lit(row, lit);
    frame.quality = out.size() > 12 ? out[12] : "";
    frame.valued = !out.at(1).empty();
    const double mor = number(out[1], 0);
    frame.held = out.at(4) == "above" ? frame.mor_m >= mor
                 : out.at(4) == "below"
                     ? frame.mor_m <= mor
                     : frame.mor_m >= number(out[2], 0) && frame.mor_m <= number(out[3], 1e9);
    frames.push_back(frame);
  }
  return frames;
}

struct Counts {
  int there = 0, flagged = 0, dry = 0, falsely = 0, held = 0, frames = 0;
};

// `there` tells in which frames the flag could be expected, `may` in which it may stand.
template <typename There, typename May>
Counts count(const std::string& event, const std::string& flag, There there, May may,
             std::vector<int> seeds) {
  Counts c;
  for (const int seed : seeds)
    for (const EventFrame& frame : replayed(event, seed)) {
      ++c.frames, c.held += frame.held;
      if (there(frame)) ++c.there, c.flagged += frame.flagged(flag);
      if (!may(frame)) ++c.dry, c.falsely += frame.flagged(flag);
    }
  std::cout << event << ": flagged " << c.flagged << " of " << c.there << ", falsely " << c.falsely << " of "
            << c.dry << "; bounds or limit held in " << c.held << " of " << c.frames << "\n";
  return c;
}

// Where enough of a target is left to be seen through the fog; a few drops are missed.
TEST(Events, RainOnTheWindowIsFlaggedAndTheBoundsHold) {
  const Counts c = count(
      "rain-on-window", "rain_on_window",
      [](const EventFrame& f) { return f.window_covered > 0.15 && f.mor_m > 600; },
      [](const EventFrame& f) { return f.window_covered > 0; }, {41, 42, 43});
  EXPECT_GE(c.there, 8);
  EXPECT_GE(c.flagged, c.there * 7 / 10);
  EXPECT_EQ(c.falsely, 0);
  EXPECT_GE(c.held, c.frames * 9 / 10);
}

}  // namespace
}  // namespace lampglow::simulation
