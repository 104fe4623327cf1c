// The main job on a simulated night: bytes that do not depend on the workers, the time's own part of an
// observation, and answers over HTTP while the replay stands.
#include <gmock/gmock.h>

#include <boost/json.hpp>
#include <memory>
#include <set>
#include <sstream>

#include "storage/reader.h"
#include "tests/support/csv_rows.h"
#include "tests/support/run_program.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using test::ProgramRun;
using test::read_all;
using test::rows_by_time;
using test::run_program;
using ::testing::HasSubstr;

// A night of counted photons, written by the program itself once for all tests. Clear at first, then fog.
class MainJob : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TempFolder>();
    const ProgramRun run =
        run_program({"simulate", night(), "--seed", "5", "--frames", "8", "--photons", "50000"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string night() { return (folder_->path() / "night").string(); }
  static std::string at(const std::string& name) { return (folder_->path() / name).string(); }

  static std::unique_ptr<TempFolder> folder_;
};
std::unique_ptr<TempFolder> MainJob::folder_;

// The archive's observations, moved together: five minutes apart. The weather changes as fast as that then.
std::string five_minutes_apart(const std::string& frames_csv) {
  std::istringstream in(frames_csv);
  std::ostringstream out;
  std::set<std::string> times;
  for (std::string line; std::getline(in, line);) {
    if (line.find(",observation,") != std::string::npos) {
      times.insert(line.substr(0, 20));
      const std::string minute = std::to_string(100 + 5 * (times.size() - 1)).substr(1);
      line.replace(0, 20, "2026-01-15T18:" + minute + ":00Z");
    }
    out << line << "\n";
  }
  return out.str();
}

TEST_F(MainJob, TheNumberOfWorkersLeavesNoTrace) {
  for (const std::string workers : {"1", "2"}) {
    const ProgramRun run =
        run_program({"replay", night(), "--workers", workers, "--csv", at(workers + ".csv"), "--db",
                     at(workers + ".db"), "--truth", night() + "/truth.csv"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_THAT(run.out, HasSubstr("0 bad frames"));
  }
  const std::string csv = read_all(at("1.csv")), content = storage::Reader(at("1.db")).content();
  EXPECT_THAT(csv, HasSubstr(",glow,")) << "the night has values to compare";
  EXPECT_EQ(csv, read_all(at("2.csv")));
  EXPECT_EQ(content, storage::Reader(at("2.db")).content());
  EXPECT_EQ(read_all(at("1.scores.json")), read_all(at("2.scores.json")));
}

// Where fog hides every lamp the answer is "at most", true and flagged, and never a guess.
TEST_F(MainJob, FogTooThickForAnyLampIsALimitBelow) {
  const ProgramRun simulated =
      run_program({"simulate", at("thick"), "--seed", "5", "--frames", "12", "--distances", "250,400,700",
                   "--mor-min", "30", "--mor-max", "150", "--photons", "100000"});
  ASSERT_EQ(simulated.exit_code, 0) << simulated.err;
  const ProgramRun replayed = run_program({"replay", at("thick"), "--csv", at("thick.csv")});
  ASSERT_EQ(replayed.exit_code, 0) << replayed.err;
  enum Column { time, mor, low, high, limit, quality = 12 };
  const auto rows = rows_by_time(read_all(at("thick.csv")));
  int limits = 0, values = 0;
  for (const auto& [when, truth] : rows_by_time(read_all(at("thick/truth.csv")))) {
    if (when == "time_utc") continue;
    const std::vector<std::string>& row = rows.at(when);
    const double true_m = std::stod(truth[1]);
    EXPECT_NE(row[limit], "above") << when;
    if (row[limit] == "below") {
      ++limits;
      EXPECT_GE(std::stod(row[mor]), true_m) << when;
      EXPECT_LT(std::stod(row[mor]), 200) << when << ": of no use";
      EXPECT_THAT(row[quality], HasSubstr("limit_below")) << when;
    } else if (!row[mor].empty()) {
      ++values;
      EXPECT_LE(std::stod(row[low]), true_m) << when;
      EXPECT_GE(std::stod(row[high]), true_m) << when;
    }
  }
  EXPECT_GE(limits, 7);
  EXPECT_GE(values, 1) << "where it thins a lamp's glow is back";
}

// Clear air after fog is "fog in the past hour" (code 20), which one frame alone can't know.
TEST_F(MainJob, ThePastHourIsPartOfPresentWeather) {
  namespace fs = std::filesystem;
  const std::string close = at("close");
  fs::copy(night(), close, fs::copy_options::recursive);
  write_file(close + "/frames.csv", five_minutes_apart(read_all(night() + "/frames.csv")));
  const ProgramRun run = run_program({"replay", close, "--workers", "2", "--db", at("close.db")});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  storage::Reader reader(at("close.db"));
  storage::ObservationQuery query;
  query.camera = reader.camera("simulated night, seed 5")->number;
  query.to = TimePoint::max();
  bool fog_before = false;
  int after_fog = 0;
  for (const auto& row : reader.observations(query)) {
    const Observation& o = row.observation;
    if (fog_before && (o.weather == Weather::mist || o.weather == Weather::haze)) {
      ++after_fog;
      EXPECT_EQ(o.wmo_4680, 20) << format_time_utc(o.time_utc);
    }
    fog_before = fog_before || o.weather == Weather::fog;
  }
  EXPECT_GT(after_fog, 0) << "the night has mist or haze within an hour after fog";
}

// A real day of a camera of which nothing is known: each of the 90 frames has a record and a reason, and no
// number is made up.
TEST(RealDay, EveryFrameHasARecordAndNoneAnInventedNumber) {
  const std::filesystem::path day =
      std::filesystem::path(LAMPGLOW_SOURCE_DIR) / "../shared/data/debilt-2015-10-09";
  if (!std::filesystem::exists(day)) GTEST_SKIP() << day << " is not there";
  const TempFolder folder;
  const auto csv = folder.path() / "day.csv";
  const ProgramRun run =
      run_program({"replay", day.string(), "--truth", (day / "truth.csv").string(), "--csv", csv.string()});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out,
              HasSubstr("90 of 90 frames done: 0 values, 0 limits, 90 without a value; 0 bad frames"));
  EXPECT_THAT(run.out, HasSubstr("43 without a value: the site file lists no day targets"));
  EXPECT_THAT(run.out, HasSubstr("47 without a value: the site file lists no lamps"));
  std::istringstream rows(read_all(csv));
  std::string row;
  std::getline(rows, row);
  int records = 0;
  for (; std::getline(rows, row); ++records) {
    EXPECT_THAT(row, HasSubstr(",,,,,,,,unknown,none,0,")) << "numbers are empty";
    EXPECT_THAT(row, ::testing::ContainsRegex("daylight|no_reference")) << "there is a reason";
  }
  EXPECT_EQ(records, 90);
}

TEST_F(MainJob, AReplayServesItsLastObservation) {
  const int port = free_port();
  Program program({LAMPGLOW_BINARY, "replay", night(), "--serve", "--port", std::to_string(port), "--csv",
                   at("served.csv")},
                  at("log"));
  std::string last;
  ASSERT_TRUE(eventually(60s, [&] {  // the files are written when all frames are done
    std::istringstream in(fs::exists(at("served.csv")) ? read_all(at("served.csv")) : "");
    for (std::string line; std::getline(in, line);) last = line;
    return last.starts_with("2026-01-16T04:30:00Z") && ask(port, "/v1/current").status == 200;
  })) << read_all(at("log"));
  EXPECT_EQ(ask(port, "/healthz").status, 200);
  const auto current = boost::json::parse(ask(port, "/v1/current").body);
  EXPECT_THAT(boost::json::serialize(current), HasSubstr("2026-01-16T04:30:00Z"));
}

}  // namespace
}  // namespace lampglow::testing
