#include "daemon/sources/archive.h"

#include <gmock/gmock.h>

#include "daemon/sources/truth.h"
#include "tests/support/messages.h"
#include "tests/support/small_archive.h"

namespace lampglow::daemon {
namespace {

using test::complaint_of;
using test::encoded;
using test::kFramesHeader;
using test::small_picture;
using test::TemporaryFolder;

Camera small_camera() {
  Camera camera;
  camera.width_px = 64;
  camera.height_px = 48;
  return camera;
}

std::string without(const std::string& prefix, std::string text) {
  for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
    text.erase(at, prefix.size());
  return text;
}

std::string frames_complaint(const std::string& rows, const std::string& header = kFramesHeader) {
  const TemporaryFolder folder;
  folder.write("frames.csv", header + rows);
  const auto complaint = complaint_of([&] { read_frames_csv(folder.path()); });
  EXPECT_TRUE(complaint.exit_code == kExitData || complaint.exit_code == 0);
  return without(folder.path().string() + "/", complaint.text);
}

TEST(Archive, GroupsBracketsByTime) {
  const TemporaryFolder folder;
  folder.write("frames.csv",
               "extra,role,file,time_utc,gain_db,reference_mor_m,exposure_s\r\n"
               "x,clear_reference,r.png,2026-01-01T00:00:00Z,,30000,0.1\r\n"
               "x,observation,\"a,1.png\",2026-01-01T00:01:00Z,6,,0.1\r\n"
               "x,observation,a2.png,2026-01-01T00:01:00Z,,,\r\n");
  const auto brackets = read_frames_csv(folder.path());
  ASSERT_EQ(brackets.size(), 2U);
  EXPECT_EQ(brackets[0].role, FrameRole::clear_reference);
  EXPECT_EQ(brackets[0].reference_mor_m, 30000);
  ASSERT_EQ(brackets[1].frames.size(), 2U);
  EXPECT_EQ(brackets[1].frames[0].file, "a,1.png");
  EXPECT_EQ(brackets[1].frames[0].exposure_s, 0.1);
  EXPECT_EQ(brackets[1].frames[0].gain_db, 6);
  EXPECT_FALSE(brackets[1].frames[1].exposure_s) << "automatic exposure is unknown, not 0";
}

TEST(Archive, TellsEveryBadRowAtOnce) {
  EXPECT_EQ(frames_complaint("yesterday,a.png,,,observation,\n"
                             "2026-01-01T00:01:00Z,../a.png,,,observation,\n"
                             "2026-01-01T00:00:00Z,/etc/passwd,-1,loud,look,5000\n"),
            "frames.csv:2:1: time_utc: expected a time such as 2015-10-09T00:04:00Z, got \"yesterday\"\n"
            "frames.csv:3:22: file: expected a path within the archive, got one with '..' (\"../a.png\")\n"
            "frames.csv:4:1: time_utc: expected rows in the order of time, 2026-01-01T00:00:00Z comes after "
            "2026-01-01T00:01:00Z\n"
            "frames.csv:4:22: file: expected a path relative to the archive, got an absolute one "
            "(\"/etc/passwd\")\n"
            "frames.csv:4:34: exposure_s: expected nothing or a number from 1e-07 to 3600, got \"-1\"\n"
            "frames.csv:4:37: gain_db: expected nothing or a number from -60 to 120, got \"loud\"\n"
            "frames.csv:4:42: role: expected observation or clear_reference, got \"look\"\n"
            "frames.csv:4:47: reference_mor_m: expected nothing for an observation");
}

TEST(Archive, StructureIsStrict) {
  EXPECT_EQ(frames_complaint("", "time_utc,file,role\n"),
            "frames.csv:1:1: exposure_s: the header lacks this column\n"
            "frames.csv:1:1: gain_db: the header lacks this column\n"
            "frames.csv:1:1: reference_mor_m: the header lacks this column");
  EXPECT_EQ(frames_complaint(""), "frames.csv:1:1: expected at least one frame");
  EXPECT_EQ(frames_complaint(
                "2026-01-01T00:01:00Z,a.png,,,observation,\n2026-01-01T00:01:00Z,b.png,,,clear_reference,\n"),
            "frames.csv:3:30: role: expected the role of the rows above that share its time");
  EXPECT_EQ(frames_complaint("2026-01-01T00:01:00Z,,,,observation,\n"),
            "frames.csv:2:22: file: expected a file's path (\"\")");
}

TEST(Archive, ASymbolicLinkIsRefused) {
  const TemporaryFolder folder;
  std::filesystem::create_symlink("/etc", folder.path() / "images");
  folder.write("frames.csv",
               std::string(kFramesHeader) + "2026-01-01T00:01:00Z,images/passwd,,,observation,\n");
  EXPECT_THAT(complaint_of([&] { read_frames_csv(folder.path()); }).text,
              testing::EndsWith(":2:22: file: expected no symbolic link in the path (\"images/passwd\")"));
}

TEST(Archive, ABadFrameIsAFlaggedBracketAndTheRestIsGiven) {
  const TemporaryFolder folder;
  folder.write("good.png", encoded(small_picture(CV_8UC1), ".png"));
  folder.write("cut.png", encoded(small_picture(CV_8UC1), ".png").substr(0, 150));
  folder.write("frames.csv", std::string(kFramesHeader) +
                                 "2026-01-01T00:01:00Z,good.png,0.1,,observation,\n"
                                 "2026-01-01T00:01:00Z,cut.png,0.2,,observation,\n"
                                 "2026-01-01T00:02:00Z,gone.png,,,observation,\n"
                                 "2026-01-01T00:03:00Z,good.png,,,observation,\n");
  ArchiveSource source(folder.path(), small_camera());
  const auto first = source.next({});
  ASSERT_TRUE(first);
  EXPECT_EQ(first->exposures.size(), 1U) << "the good exposure of the bracket stays";
  EXPECT_TRUE(first->quality.has(Quality::frame_truncated));
  EXPECT_EQ(first->fault, "cut.png: the file ends before the picture does");
  const auto second = source.next({});
  ASSERT_TRUE(second);
  EXPECT_TRUE(second->exposures.empty());
  EXPECT_TRUE(second->quality.has(Quality::frame_missing));
  EXPECT_TRUE(source.next({})->quality.empty());
  EXPECT_FALSE(source.next({}));
}

TEST(Archive, StopsWhenAsked) {
  const TemporaryFolder folder;
  folder.write("frames.csv", std::string(kFramesHeader) + "2026-01-01T00:01:00Z,a.png,,,observation,\n");
  ArchiveSource source(folder.path(), small_camera());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

std::string truth_complaint(const std::string& text) {
  const TemporaryFolder folder;
  const auto file = folder.write("t.csv", text);
  return without(folder.path().string() + "/", complaint_of([&] { read_truth(file); }).text);
}

TEST(Truth, ReadsWhatTheSensorSaid) {
  const TemporaryFolder folder;
  const auto file = folder.write("t.csv",
                                 "weather,twist,mor_m,time_utc,q\nfog,x,140,2026-01-01T00:02:00Z,0.9\n"
                                 ",,,2026-01-01T00:01:00Z,\n");
  const auto truths = read_truth(file);
  ASSERT_EQ(truths.size(), 2U);
  EXPECT_FALSE(truths[0].mor_m) << "in the order of time";
  EXPECT_EQ(truths[1].mor_m, 140);
  EXPECT_EQ(truths[1].weather, Weather::fog);
  EXPECT_EQ(truths[1].q, 0.9);
}

TEST(Truth, TellsEveryBadRowAtOnce) {
  EXPECT_EQ(truth_complaint("time_utc,mor_m,weather\n2026-01-01,1,fog\n2026-01-01T00:01:00Z,far,foggy\n"
                            "2026-01-01T00:02:00Z,5,\n2026-01-01T00:02:00Z,6,\n"),
            "t.csv:2:1: time_utc: expected a time such as 2015-10-09T00:04:00Z, got \"2026-01-01\"\n"
            "t.csv:3:22: mor_m: expected nothing or a number from 0.1 to 10000000, got \"far\"\n"
            "t.csv:3:26: weather: expected clear, haze, mist, fog, rain or unknown, got \"foggy\"\n"
            "t.csv:5:1: time_utc: expected one mor_m for a time; 2026-01-01T00:02:00Z has two");
  EXPECT_EQ(truth_complaint("time_utc,mor\n"), "t.csv:1:1: mor_m: the header lacks this column");
}

}  // namespace
}  // namespace lampglow::daemon
