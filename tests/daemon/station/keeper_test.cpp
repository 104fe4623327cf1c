// The keeper of the database against a disk that fails.
#include "daemon/station/keeper.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <fstream>

#include "daemon/station/picture_keeper.h"
#include "storage/reader.h"
#include "storage/references.h"
#include "tests/storage/sample.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::daemon {
namespace {

using testing::HasSubstr;
using namespace testing_support;
using Clock = std::chrono::steady_clock;

class KeeperTest : public testing::Test {
 protected:
  std::unique_ptr<Keeper> keeper() {
    auto made = std::make_unique<Keeper>(
        file, storage::Retention{}, std::chrono::minutes(10),
        KeeperCallbacks{[this](const storage::Event& event) { events.push_back(event); },
                        [this](const std::string& text) { fault = text; }, [](std::chrono::seconds) {},
                        [this](const storage::FileId& id) { opened = id; }});
    made->add_camera("quay", harbour());
    return made;
  }
  int stored() {
    storage::Reader reader(file);
    return static_cast<int>(
        reader.observations({1, TimePoint{}, at("2100-01-01T00:00:00Z"), 0, {}, 100000}).size());
  }
  std::vector<std::filesystem::path> set_aside() {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
      if (const std::string name = entry.path().filename().string();
          name.find(".corrupt-") != std::string::npos && name.ends_with("Z"))
        found.push_back(entry.path());
    return found;
  }
  void fill(Keeper& k, int from, int to) {
    for (int i = from; i < to; ++i) k.put("quay", foggy(start + std::chrono::minutes(i)));
  }

  test::TemporaryFolder folder;
  std::filesystem::path file = folder.path() / "lampglow.db";
  TimePoint start = at("2026-11-22T00:00:00Z");
  std::vector<storage::Event> events;
  std::string fault;
  storage::FileId opened;
};

TEST_F(KeeperTest, AFreshDatabaseGetsTheReferenceInForce) {
  auto k = keeper();
  storage::ReferenceRecord record;
  record.lamps = {{"L1", 3.5, -0.1, {}, 0, {}}};
  k->put_reference("quay", record);
  record.origin = storage::ReferenceOrigin::relearned;
  k->put_reference("quay", record);
  EXPECT_EQ(storage::ReferenceReader(file).references(1).size(), 2U);
  std::filesystem::remove(file);
  k->tick(start, Clock::now() + std::chrono::hours(1));
  k->tick(start, Clock::now() + std::chrono::hours(2));
  const auto kept = storage::ReferenceReader(file).references(1);
  ASSERT_EQ(kept.size(), 1U);
  EXPECT_EQ(kept[0].origin, storage::ReferenceOrigin::relearned);
}

TEST_F(KeeperTest, EveryFrameIsThereAtOnceForReaders) {
  auto k = keeper();
  fill(*k, 0, 3);
  EXPECT_EQ(stored(), 3);
  EXPECT_EQ(fault, "");
}

TEST_F(KeeperTest, ADamagedDatabaseIsSetAsideAtTheStartLoudly) {
  {
    auto k = keeper();
    fill(*k, 0, 300);
    k->close();
  }
  {
    std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
    stream.seekp(static_cast<std::streamoff>(std::filesystem::file_size(file) / 2));
    stream << std::string(8192, '\x5a');
  }
  auto k = keeper();
  fill(*k, 300, 302);
  EXPECT_EQ(stored(), 2);
  EXPECT_EQ(set_aside().size(), 1u);
  k->tick(start, Clock::now());
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.front().kind, storage::EventKind::database_set_aside);
  EXPECT_EQ(events.front().severity, storage::Severity::error);
  EXPECT_THAT(events.front().message, HasSubstr(".corrupt-"));
}

TEST_F(KeeperTest, ADeletedDatabaseIsMadeAnewWhileRunning) {
  auto k = keeper();
  fill(*k, 0, 2);
  std::filesystem::remove(file);
  std::filesystem::remove(file.string() + "-wal");
  std::filesystem::remove(file.string() + "-shm");
  k->tick(start, Clock::now() + std::chrono::seconds(6));
  fill(*k, 2, 5);
  EXPECT_EQ(stored(), 3);
  ASSERT_FALSE(events.empty());
  EXPECT_THAT(events.front().message, HasSubstr("was removed"));
}

TEST_F(KeeperTest, ABackupPutBackWhileRunningIsGoneOnWithAndTheOldWalDoesNotSpoilIt) {
  {
    auto k = keeper();
    fill(*k, 0, 30);
    k->close();
  }
  const auto backup = folder.path() / "backup.db";
  ASSERT_TRUE(storage::backup(file, backup));
  auto k = keeper();
  fill(*k, 30, 60);  // these are in the WAL
  std::filesystem::rename(backup, file);
  k->tick(start, Clock::now() + std::chrono::hours(1));
  fill(*k, 60, 70);
  EXPECT_EQ(stored(), 40);
  k->close();
  EXPECT_EQ(storage::check(file, true), "ok");
  EXPECT_TRUE(set_aside().empty());
  EXPECT_THAT(events.back().message, HasSubstr("was replaced; the station goes on with the one"));
}

// What was put in place is of a later lampglow: it is not touched, and the frames wait.
TEST_F(KeeperTest, ALaterDatabasePutInPlaceWhileRunningIsAFault) {
  auto k = keeper();
  fill(*k, 0, 5);
  const auto later = folder.path() / "later.db";
  SQLite::Database(later.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
      .exec("PRAGMA user_version = 99; CREATE TABLE t (x)");
  std::filesystem::rename(later, file);
  k->tick(start, Clock::now() + std::chrono::hours(1));
  fill(*k, 5, 8);
  EXPECT_THAT(fault, HasSubstr("later lampglow"));
  EXPECT_EQ(k->waiting(), 3u);
  EXPECT_TRUE(set_aside().empty());
}

TEST_F(KeeperTest, DamageOfAFileThatIsGoneSetsNothingAside) {
  auto k = keeper();
  fill(*k, 0, 5);
  const storage::FileId before = opened;
  const std::ifstream held(
      file);  // so that the fresh one has another inode also where no file's birth is told
  std::filesystem::remove(file);
  k->tick(start, Clock::now() + std::chrono::hours(1));
  ASSERT_NE(opened, before);
  k->set_aside_damaged(before, "found in the old one");
  EXPECT_TRUE(set_aside().empty());
  k->set_aside_damaged(opened, "found in this one");
  EXPECT_EQ(set_aside().size(), 1u);
}

TEST_F(KeeperTest, AClockThatIsAYearAheadDropsNextToNothing) {
  {
    auto before = keeper();
    fill(*before, 0, 3 * 24 * 60);
    before->close();
  }
  auto k = keeper();
  const auto now = Clock::now();
  const TimePoint wrong = start + std::chrono::hours(24 * 500);
  k->tick(wrong, now);
  for (int minute = 0; minute < 60; minute += 6) k->tick(wrong, now + std::chrono::minutes(minute));
  EXPECT_EQ(stored(), 3 * 24 * 60);
  EXPECT_THAT(events.back().message, HasSubstr("the clock is 496 days ahead of the newest stored frame"));
  // Nor do some hours of frames with that time and a restart within them.
  for (int minute = 0; minute < 300; minute += 5) k->put("quay", foggy(wrong + std::chrono::minutes(minute)));
  k->close();
  k = keeper();
  k->tick(wrong + std::chrono::hours(5), now);
  EXPECT_EQ(stored(), 3 * 24 * 60 + 60);
  // If it was right, the station was off for so long, it is followed in the end.
  for (int hour = 1; hour < 600; ++hour) k->tick(wrong, now + std::chrono::hours(hour));
  EXPECT_EQ(stored(), 60);
}

// A file size limit is what a full disk looks like to SQLite: the write fails, and later it does not.
TEST_F(KeeperTest, AFullDiskMakesObservationsWaitAndNoneIsLost) {
  auto k = keeper();
  fill(*k, 0, 5);
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 8192;
  setrlimit(RLIMIT_FSIZE, &small);
  fill(*k, 5, 40);
  setrlimit(RLIMIT_FSIZE, &before);
  EXPECT_GT(k->waiting(), 0u);
  EXPECT_NE(fault, "");
  k->tick(start, Clock::now() + std::chrono::seconds(11));
  EXPECT_EQ(k->waiting(), 0u);
  EXPECT_EQ(stored(), 40);
  EXPECT_EQ(fault, "");
  EXPECT_EQ(k->lost(), 0u);
}

TEST_F(KeeperTest, WhatCameBeforeAKillIsThere) {
  const pid_t child = fork();
  if (child == 0) {
    auto k = keeper();
    fill(*k, 0, 20);
    raise(SIGKILL);
  }
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFSIGNALED(status));
  auto k = keeper();
  EXPECT_EQ(stored(), 20);
  EXPECT_TRUE(set_aside().empty());
}

TEST_F(KeeperTest, PicturesStayWithinTheirSpaceAndTheOldestGo) {
  auto k = keeper();
  PictureOptions options;
  options.max_bytes = 2500;
  PictureKeeper pictures(folder.path() / "pictures", options);
  for (int hour = 0; hour < 5; ++hour) {
    pictures.offer("quay", start + std::chrono::hours(hour), false, std::string(1000, 'x'), *k);
    pictures.offer("quay", start + std::chrono::hours(hour) + std::chrono::minutes(5), false,
                   std::string(1000, 'x'), *k);
  }
  storage::Reader reader(file);
  const auto kept = reader.pictures({}, TimePoint{}, at("2100-01-01T00:00:00Z"), 100);
  ASSERT_EQ(kept.size(), 2u);
  EXPECT_EQ(kept[0].time_utc, start + std::chrono::hours(3));
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path() / "pictures" / "quay"))
    files += entry.is_regular_file();
  EXPECT_EQ(files, 2);
}

TEST_F(KeeperTest, OnsetsOfFogOutlastHourlyPicturesUpToHalfOfTheSpace) {
  auto k = keeper();
  PictureOptions options;
  options.max_bytes = 6000;
  PictureKeeper pictures(folder.path() / "pictures", options);
  const auto kept = [&] {
    std::vector<std::string> out;
    for (const auto& picture :
         storage::Reader(file).pictures({}, TimePoint{}, at("2100-01-01T00:00:00Z"), 100))
      out.push_back(
          std::to_string(std::chrono::duration_cast<std::chrono::hours>(picture.time_utc - start).count()) +
          " " + std::string(to_string(picture.kept_for)));
    return out;
  };
  const auto offer = [&](int hour, bool fog_began) {
    pictures.offer("quay", start + std::chrono::hours(hour), fog_began, std::string(1000, 'x'), *k);
  };
  for (int hour = 0; hour < 20; ++hour) offer(hour, hour == 2 || hour == 5);
  EXPECT_THAT(kept(), testing::ElementsAre("2 fog_onset", "5 fog_onset", "16 hourly", "17 hourly",
                                           "18 hourly", "19 hourly"));
  for (int hour = 20; hour < 28; ++hour) offer(hour, true);
  EXPECT_THAT(kept(), testing::ElementsAre("17 hourly", "18 hourly", "19 hourly", "25 fog_onset",
                                           "26 fog_onset", "27 fog_onset"));
}

TEST_F(KeeperTest, EveryOnsetOfFogIsKeptAndOneAnHour) {
  auto k = keeper();
  PictureKeeper pictures(folder.path() / "pictures", {});
  FogWatch fog;
  // Minutes of the night and what was seen then; fog begins at 10, 130 and 131 + 59 (after a clear spell).
  for (int minute = 0; minute < 240; ++minute) {
    const double mor_m = (minute >= 10 && minute < 100) || minute == 130 || minute >= 190 ? 400 : 5000;
    const TimePoint time = start + std::chrono::minutes(minute);
    const bool began =
        fog.note(foggy(time, kMorTimesExtinction / mor_m).observation) == FogWatch::Change::began;
    pictures.offer("quay", time, began, "jpeg of minute " + std::to_string(minute), *k);
  }
  std::vector<std::string> kept;
  for (const auto& picture :
       storage::Reader(file).pictures({}, TimePoint{}, at("2100-01-01T00:00:00Z"), 100)) {
    const auto minute = std::chrono::duration_cast<std::chrono::minutes>(picture.time_utc - start).count();
    kept.push_back(std::to_string(minute) + " " + std::string(to_string(picture.kept_for)));
    EXPECT_EQ(test::read_all(folder.path() / "pictures/quay" /
                             (std::to_string(picture.time_utc.time_since_epoch().count()) + ".jpg")),
              "jpeg of minute " + std::to_string(minute));
  }
  EXPECT_THAT(kept, testing::ElementsAre("0 hourly", "10 fog_onset", "60 hourly", "120 hourly",
                                         "130 fog_onset", "180 hourly", "190 fog_onset"));
}

// Weeks of a disk that fails must not fill the memory.
TEST_F(KeeperTest, OnlySoManyEventsWait) {
  auto k = keeper();
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  signal(SIGXFSZ, SIG_IGN);
  rlimit small = before;
  small.rlim_cur = 8192;
  setrlimit(RLIMIT_FSIZE, &small);
  fill(*k, 0, 1);
  for (int i = 0; i < 3000; ++i)
    k->put_event({0, start + std::chrono::seconds(i), storage::EventKind::source_failed,
                  storage::Severity::warning, "quay", std::to_string(i)});
  setrlimit(RLIMIT_FSIZE, &before);
  k->tick(start, Clock::now() + std::chrono::seconds(11));
  const auto stored = storage::Reader(file).events(0, 10000);
  EXPECT_EQ(stored.size(), Keeper::kMostWaiting + 1);  // and that the disk is well again
  EXPECT_EQ(stored.at(stored.size() - 2).message, "2999");
  EXPECT_EQ(stored.back().kind, storage::EventKind::database_recovered);
}

TEST_F(KeeperTest, PicturesOfADatabaseThatIsGoneCountAndGoFirst) {
  PictureOptions options;
  options.max_bytes = 2500;
  const auto folder_of_quay = folder.path() / "pictures" / "quay";
  {
    auto k = keeper();
    PictureKeeper pictures(folder.path() / "pictures", options);
    for (int hour = 0; hour < 2; ++hour)
      pictures.offer("quay", start + std::chrono::hours(hour), false, std::string(1000, 'x'), *k);
  }
  for (const char* suffix : {"", "-wal", "-shm"}) std::filesystem::remove(file.string() + suffix);
  std::ofstream(folder_of_quay / "note.txt") << "not ours";
  std::ofstream(folder_of_quay / "1795305600000.jpg.aB3dE9") << "half a picture of a process that was killed";
  auto k = keeper();
  PictureKeeper pictures(folder.path() / "pictures", options);
  pictures.load({});
  pictures.offer("quay", start + std::chrono::hours(2), false, std::string(1000, 'x'), *k);
  const auto file_at = [&](int hour) {
    return folder_of_quay /
           (std::to_string((start + std::chrono::hours(hour)).time_since_epoch().count()) + ".jpg");
  };
  EXPECT_FALSE(std::filesystem::exists(file_at(0)));
  EXPECT_TRUE(std::filesystem::exists(file_at(1)));
  EXPECT_TRUE(std::filesystem::exists(file_at(2)));
  EXPECT_TRUE(std::filesystem::exists(folder_of_quay / "note.txt"));
  EXPECT_FALSE(std::filesystem::exists(folder_of_quay / "1795305600000.jpg.aB3dE9"));
}

TEST_F(KeeperTest, APictureFolderWithClosedPartsIsNoReasonToFail) {
  const auto closed = folder.path() / "pictures" / "lost+found";
  std::filesystem::create_directories(closed);
  const pid_t child = fork();
  if (child == 0) {  // root may look everywhere
    std::filesystem::permissions(folder.path(), std::filesystem::perms::all);
    std::filesystem::permissions(closed, std::filesystem::perms::none);
    if (geteuid() == 0 && setuid(65534) != 0) _exit(2);
    try {
      PictureKeeper(folder.path() / "pictures", {}).load({});
    } catch (const std::exception&) {
      _exit(1);
    }
    _exit(0);
  }
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(FogWatch, BeginsBelow1000AndEndsAbove1200) {
  FogWatch watch;
  const auto note = [&](double mor_m, Limit limit = Limit::none) {
    Observation o = foggy(at("2026-11-22T00:00:00Z"), kMorTimesExtinction / mor_m).observation;
    o.limit = limit;
    return watch.note(o);
  };
  EXPECT_EQ(note(1100), FogWatch::Change::none);
  EXPECT_EQ(note(900, Limit::above), FogWatch::Change::none);
  EXPECT_EQ(note(990), FogWatch::Change::began);
  EXPECT_EQ(note(1150), FogWatch::Change::none);
  EXPECT_EQ(note(1250), FogWatch::Change::ended);
}

TEST(FogWatch, AFogThatNothingWasSeenOfForAnHourBeginsAnew) {
  FogWatch watch;
  const auto note_at = [&](const char* time) { return watch.note(foggy(at(time)).observation); };
  EXPECT_EQ(note_at("2026-11-22T06:00:00Z"), FogWatch::Change::began);
  EXPECT_EQ(note_at("2026-11-22T07:00:00Z"), FogWatch::Change::none);
  EXPECT_EQ(note_at("2026-11-21T07:30:00Z"), FogWatch::Change::none) << "the clock was set back";
  EXPECT_EQ(note_at("2026-11-22T17:00:00Z"), FogWatch::Change::began);
}

}  // namespace
}  // namespace lampglow::daemon
