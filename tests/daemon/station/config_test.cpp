#include "daemon/station/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/errors.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::daemon {
namespace {

using testing::AllOf;
using testing::HasSubstr;

const std::string kSite = R"(
[site]
name = "quay"
latitude_deg = 52.0
longitude_deg = 5.0
[camera]
width_px = 64
height_px = 48
bit_depth = 8
black_level_dn = 0.0
saturation_dn = 255.0
response = "linear"
)";
const std::string kSource = "[source]\nurl = \"watch:incoming\"\n";

StationConfig parse(const std::string& text) {
  return parse_station_config(text, "/etc/lampglow/lampglow.toml");
}

std::string complaint(const std::string& text) {
  try {
    parse(text);
  } catch (const ConfigError& error) {
    EXPECT_EQ(error.exit_code(), 78);
    return error.what();
  }
  return "no complaint";
}

TEST(StationConfig, ClearNightsTeachUnlessToldOtherwise) {
  const auto relearn = [](const std::string& more) {
    return parse(kSite + kSource + more).cameras.at(0).relearn;
  };
  ASSERT_TRUE(relearn(""));
  EXPECT_EQ(relearn("")->clear_mor_m, 6000);
  EXPECT_EQ(relearn("[reference]\nclear_mor_m = 8000.0\nstep_cap = 0.02\n")->clear_mor_m, 8000);
  EXPECT_EQ(relearn("[reference]\nstep_cap = 0.02\n")->step_cap, 0.02);
  EXPECT_FALSE(relearn("[reference]\nrelearn = false\n"));
  EXPECT_THAT(complaint(kSite + kSource + "[reference]\nclear_mor_m = 500.0\n"), HasSubstr("clear_mor_m"));
  EXPECT_NE(parse(kSite + kSource).cameras.at(0).fingerprint,
            parse(kSite + kSource + "[reference]\nrelearn = false\n").cameras.at(0).fingerprint)
      << "a reload takes it over";
}

TEST(StationConfig, OneCameraWithItsTablesInTheFile) {
  const StationConfig config =
      parse(kSite + kSource +
            "[schedule]\ninterval_s = 30\nin_fog_s = 10\nwhen = \"night\"\n"
            "[http]\nport = 9000\n[keep]\nframes_days = 30\nbackups = 0\n"
            "[pictures]\nmax_megabytes = 5\n[station]\ndata_directory = \"/tmp/x\"\n");
  ASSERT_EQ(config.cameras.size(), 1u);
  EXPECT_EQ(config.cameras[0].name, "quay");
  EXPECT_EQ(config.cameras[0].site.latitude_deg, 52.0);
  EXPECT_EQ(config.cameras[0].source.url, "watch:/etc/lampglow/incoming");
  EXPECT_EQ(config.cameras[0].schedule.interval, std::chrono::seconds(30));
  EXPECT_EQ(config.cameras[0].schedule.in_fog, std::chrono::seconds(10));
  EXPECT_EQ(config.cameras[0].schedule.part, DayPart::night);
  EXPECT_EQ(config.http.address, "127.0.0.1");
  EXPECT_EQ(config.http.port, 9000);
  EXPECT_EQ(config.retention.frames_days, 30);
  EXPECT_EQ(config.backup_hour_utc, -1);
  EXPECT_EQ(config.pictures.max_bytes, 5'000'000);
  EXPECT_EQ(config.database(), "/tmp/x/lampglow.db");
}

TEST(StationConfig, SeveralCamerasWithASiteFileEach) {
  const test::TemporaryFolder folder;
  folder.write("east.toml", kSite);
  const auto file = folder.write(
      "lampglow.toml",
      "[[cameras]]\nname = \"east\"\nsite_file = \"east.toml\"\n[cameras.source]\nurl = "
      "\"rtsp://10.0.0.2/stream\"\n[[cameras]]\nname = \"west\"\nsite_file = \"east.toml\"\n"
      "[cameras.source]\nurl = \"http://10.0.0.3/snap.jpg\"\n[cameras.schedule]\ninterval_s = 20\n");
  const StationConfig config = read_station_config(file);
  ASSERT_EQ(config.cameras.size(), 2u);
  EXPECT_EQ(config.cameras[1].name, "west");
  EXPECT_EQ(config.cameras[1].schedule.interval, std::chrono::seconds(20));
  EXPECT_EQ(config.cameras[0].site.camera.width_px, 64);
  EXPECT_NE(config.cameras[0].fingerprint, config.cameras[1].fingerprint);
}

TEST(StationConfig, TellsEverythingWrongAtOnceWithLineAndNearestKey) {
  EXPECT_THAT(complaint(kSite + kSource + "[http]\nprot = 1\naddress = 5\n[keep]\nframes_days = -1\n"),
              AllOf(HasSubstr("lampglow.toml:"), HasSubstr("did you mean port?"), HasSubstr("http.address"),
                    HasSubstr("keep.frames_days")));
}

TEST(StationConfig, ANameThatCannotStandInAUrlIsRefused) {
  EXPECT_THAT(complaint("name = \"../x\"\n" + kSite + kSource), HasSubstr("letters, digits, '-' or '_'"));
}

TEST(StationConfig, ProtectionWithoutTokensIsRefused) {
  EXPECT_THAT(complaint(kSite + kSource + "[http]\nprotect = \"everything\"\n"),
              HasSubstr("is of no use without token_hashes"));
  EXPECT_THAT(complaint(kSite + kSource + "[http]\ntoken_hashes = [\"secret\"]\n"),
              HasSubstr("64 hexadecimal digits"));
  EXPECT_THAT(complaint(kSite + kSource + "[http]\ntls_key = \"k\"\n"), HasSubstr("belong together"));
}

TEST(StationConfig, SaysWhatOnlyARestartChanges) {
  const StationConfig running = parse(kSite + kSource);
  EXPECT_THAT(needs_restart(running, parse(kSite + kSource + "[keep]\nframes_days = 1\n")),
              testing::IsEmpty());
  EXPECT_THAT(needs_restart(running, parse(kSite + kSource + "[http]\nport = 1\n[station]\nworkers = 7\n")),
              testing::ElementsAre("station.workers", "http.port"));
  const std::string with_tls = "[http]\ntls_certificate = \"a\"\ntls_key = \"b\"\n";
  EXPECT_THAT(needs_restart(running, parse(kSite + kSource + with_tls)),
              testing::ElementsAre("http.tls_certificate"));
  EXPECT_THAT(needs_restart(parse(kSite + kSource + with_tls),
                            parse(kSite + kSource + "[http]\ntls_certificate = \"c\"\ntls_key = \"d\"\n")),
              testing::IsEmpty());
}

}  // namespace
}  // namespace lampglow::daemon
