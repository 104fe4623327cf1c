// Lamps that age by 20 % behind a window that loses 15 %, over simulated nights of counted photons: with
// relearning the last night is still measured within its bounds; a week of fog teaches nothing; the audit
// trail is in the database, a restart goes on from it, and an operator can go back.
#include <gmock/gmock.h>
#include <signal.h>

#include <cmath>
#include <map>
#include <memory>
#include <sstream>

#include "storage/reader.h"
#include "storage/references.h"
#include "tests/support/csv_rows.h"
#include "tests/support/run_program.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using storage::ReferenceOrigin;
using storage::ReferenceRecord;
using test::ProgramRun;
using test::read_all;
using test::rows_by_time;
using test::run_program;
using ::testing::HasSubstr;
using ::testing::Not;

ProgramRun run_well(const std::vector<std::string>& arguments) {
  ProgramRun run = run_program(arguments);
  EXPECT_EQ(run.exit_code, 0) << run.err;
  return run;
}

// Seven nights, ten frames each: six clear ones, then one with all weather.
class Relearning : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<TempFolder>();
    run_well({"simulate", at("wear"), "--seed", "61", "--nights", "7", "--clear-nights", "6", "--frames",
              "70", "--ageing", "0.2", "--dirt", "0.15", "--photons", "100000"});
  }
  static void TearDownTestSuite() { folder_.reset(); }
  static std::string at(const std::string& name) { return (folder_->path() / name).string(); }
  static std::unique_ptr<TempFolder> folder_;
};
std::unique_ptr<TempFolder> Relearning::folder_;

// Of the frames from `since` on with MOR up to 8 km.
struct Score {
  int frames = 0, covered = 0;
  double bias = 0;  // mean of ln(estimate/truth) over values
};

Score score_since(const std::string& csv, const std::string& truth_csv, const std::string& since) {
  Score score;
  int values = 0;
  const auto rows = rows_by_time(read_all(csv));
  for (const auto& [time, truth] : rows_by_time(read_all(truth_csv))) {
    if (time < since || time == "time_utc") continue;
    const double mor_m = std::stod(truth.at(1));
    if (mor_m > 8000) continue;
    const auto& row = rows.at(time);  // time_utc,mor_m,mor_low_m,mor_high_m,limit,...
    ++score.frames;
    const double low = row.at(2).empty() ? 0 : std::stod(row.at(2));
    const double high = row.at(3).empty() ? 1e9 : std::stod(row.at(3));
    if (!row.at(1).empty() && low <= mor_m && mor_m <= high) ++score.covered;
    if (row.at(1).empty() || !row.at(4).empty()) continue;
    score.bias += std::log(std::stod(row.at(1)) / mor_m);
    ++values;
  }
  if (values > 0) score.bias /= values;
  return score;
}

std::vector<ReferenceRecord> references_in(const std::string& database) {
  const auto camera = storage::Reader(database).cameras().at(0);
  return storage::ReferenceReader(database).references(camera.number);
}

TEST_F(Relearning, LaterNightsStayWithinTheirBounds) {
  run_well({"replay", at("wear"), "--csv", at("fixed.csv")});
  run_well({"replay", at("wear"), "--relearn", "--workers", "1", "--csv", at("1.csv"), "--db", at("1.db")});
  run_well({"replay", at("wear"), "--relearn", "--workers", "3", "--csv", at("3.csv"), "--db", at("3.db")});
  EXPECT_EQ(read_all(at("1.csv")), read_all(at("3.csv")));
  EXPECT_EQ(storage::Reader(at("1.db")).content(), storage::Reader(at("3.db")).content());

  const std::string last_night = "2026-01-21T12:00:00Z";
  const Score fixed = score_since(at("fixed.csv"), at("wear/truth.csv"), last_night);
  const Score relearned = score_since(at("1.csv"), at("wear/truth.csv"), last_night);
  std::printf(
      "last night, MOR up to 8 km: %d of %d within 95 %% bounds, mean ln(estimate/truth) %+.3f; without "
      "relearning %d of %d, %+.3f\n",
      relearned.covered, relearned.frames, relearned.bias, fixed.covered, fixed.frames, fixed.bias);
  ASSERT_GE(relearned.frames, 6);
  EXPECT_GE(relearned.covered, relearned.frames - 1);
  EXPECT_GE(relearned.covered, fixed.covered);
  EXPECT_LT(std::abs(relearned.bias), 0.1);

  // What is left of 0.8 * 0.85 at the end of the sixth night: the reference lags behind by some nights.
  const auto trail = references_in(at("1.db"));
  ASSERT_GE(trail.size(), 4U);
  EXPECT_EQ(trail.front().origin, ReferenceOrigin::clear_brackets);
  for (size_t i = 1; i < trail.size(); ++i) {
    EXPECT_EQ(trail[i].origin, ReferenceOrigin::relearned);
    EXPECT_GE(trail[i].hours, 2);
    EXPECT_GE(trail[i].frames, 3);
    EXPECT_GE(trail[i].mor_low_m.value_or(0), 6000);
  }
  const auto now = storage::ReferenceReader(at("1.db")).reference(1);
  ASSERT_TRUE(now);
  double mean = 0;
  for (const auto& lamp : now->lamps) mean += lamp.ln_relearned / static_cast<double>(now->lamps.size());
  std::printf("ln strength relearned, mean over lamps: %+.3f; true at the end %+.3f\n", mean,
              std::log(0.8 * 0.85));
  EXPECT_LT(mean, -0.1);
  EXPECT_GT(mean, std::log(0.8 * 0.85) - 0.03);

  const auto events = storage::Reader(at("1.db")).events(0, 100);
  int told = 0;
  for (const auto& event : events) told += event.kind == storage::EventKind::reference_learned;
  EXPECT_EQ(told, static_cast<int>(trail.size()) - 1);
}

TEST_F(Relearning, FogAllWeekTeachesNothing) {
  run_well({"simulate", at("fog"), "--seed", "62", "--nights", "4", "--frames", "40", "--ageing", "0.2",
            "--dirt", "0.15", "--mor-min", "60", "--mor-max", "950", "--photons", "100000"});
  run_well({"replay", at("fog"), "--csv", at("fog-fixed.csv")});
  run_well({"replay", at("fog"), "--relearn", "--csv", at("fog.csv"), "--db", at("fog.db")});
  EXPECT_EQ(read_all(at("fog.csv")), read_all(at("fog-fixed.csv")));
  EXPECT_EQ(references_in(at("fog.db")).size(), 1U) << "the clear brackets' own";
  // It was fog, and every frame says so by a value: nothing was left out for want of an answer.
  int foggy = 0;
  for (const auto& [when, row] : rows_by_time(read_all(at("fog.csv"))))
    if (row[4].empty() && !row[1].empty() && row[9] == "fog") foggy += std::stod(row[1]) < 1000;
  EXPECT_EQ(foggy, 40);
}

// Two lamps of five send their light down; photons say by how much their halos are stronger for it.
TEST_F(Relearning, FogTeachesWhichLampsAreCutOff) {
  run_well(
      {"simulate",          at("mixed"), "--seed",    "63",       "--luminaire", "mixed",     "--distances",
       "60,80,110,150,200", "--nights",  "3",         "--frames", "18",          "--mor-min", "150",
       "--mor-max",         "950",       "--without", "dimming",  "--photons",   "100000"});
  const std::string told =
      run_well({"replay", at("mixed"), "--relearn", "--csv", at("mixed.csv"), "--db", at("mixed.db")}).out;
  EXPECT_THAT(told, HasSubstr("halo strengths relearned from"));
  EXPECT_THAT(run_well({"reference", "list", at("mixed.db")}).out, HasSubstr("halos from"));
  const auto now = storage::ReferenceReader(at("mixed.db")).reference(1);
  ASSERT_TRUE(now);
  EXPECT_GT(now->halo_frames, 0);
  double cutoff = 0, even = 0, sum = 0;
  for (const auto& lamp : now->lamps) {
    sum += lamp.ln_halo;
    EXPECT_EQ(lamp.ln_relearned, 0) << "fog taught a strength";
    if (lamp.id == "L2" || lamp.id == "L4") cutoff += lamp.ln_halo / 2;
    if (lamp.id == "L1" || lamp.id == "L3" || lamp.id == "L5") even += lamp.ln_halo / 3;
  }
  std::printf("ln halo of cut-off lamps %+.3f, of even ones %+.3f\n", cutoff, even);
  EXPECT_NEAR(sum, 0, 1e-9) << "what all share";
  EXPECT_GT(cutoff - even, 0.1);
}

TEST_F(Relearning, TheStationRelearnsRemembersAndGoesBack) {
  TempFolder folder;
  const int port = free_port();
  const std::string config = (folder / "station.toml").string(),
                    data = (folder / "data/lampglow.db").string();
  const auto configure = [&](const std::string& interval_s) {
    write_file(config, "name = \"quay\"\nsite_file = \"" + at("wear/site.toml") +
                           "\"\n[source]\nurl = \"archive:" + at("wear") +
                           "\"\n[schedule]\ninterval_s = " + interval_s +
                           "\nwhen = \"both\"\n[station]\ndata_directory = \"data\"\n[http]\nport = " +
                           std::to_string(port) + "\n");
  };
  configure("1");
  const auto changes = [&] {
    try {
      return references_in(data).size();
    } catch (const std::exception&) {
      return std::size_t{0};
    }
  };
  {
    Serving station(config, folder / "log");
    ASSERT_TRUE(eventually(120s, [&] { return changes() >= 3; })) << station.log();
    EXPECT_THAT(station.log(), HasSubstr("clear reference relearned from"));
    EXPECT_THAT(ask(port, "/v1/events").body, HasSubstr("clear reference relearned from"));
    station.signal(SIGTERM);
    EXPECT_EQ(station.wait(10s), 0) << station.log();
  }
  const auto before = storage::ReferenceReader(data).reference(1);
  ASSERT_TRUE(before);
  configure("3600");  // one frame: no night passes
  {
    Serving station(config, folder / "log2");
    ASSERT_TRUE(eventually(20s, [&] { return ask(port, "/v1/lights").status == 200; })) << station.log();
    EXPECT_THAT(station.log(), Not(HasSubstr("other clear brackets")));
    EXPECT_EQ(storage::ReferenceReader(data).reference(1)->number, before->number)
        << "goes on from the stored one";
    const ProgramRun restored = run_well({"reference", "restore", data, "1"});
    EXPECT_THAT(restored.out, HasSubstr("clear reference 1 restored by hand"));
    station.signal(SIGHUP);
    ASSERT_TRUE(eventually(20s, [&] { return station.log().find("origin=restored") != std::string::npos; }))
        << station.log();
    station.signal(SIGTERM);
    EXPECT_EQ(station.wait(10s), 0) << station.log();
  }
  const std::string list = run_well({"reference", "list", data}).out;
  EXPECT_THAT(list, HasSubstr("clear_brackets"));
  EXPECT_THAT(list, HasSubstr("relearned"));
  EXPECT_THAT(list, HasSubstr("number 1 restored by hand"));
  const std::string first = run_well({"reference", "show", data, "1"}).out;
  EXPECT_THAT(first, HasSubstr("never"));
  EXPECT_EQ(run_program({"reference", "show", data, "999"}).exit_code, 64);
}

}  // namespace
}  // namespace lampglow::testing
