#include "storage/maintenance.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <map>
#include <thread>

#include "storage/reader.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using namespace testing_support;

class MaintenanceTest : public testing::Test {
 protected:
  // One frame a minute from `first` on.
  void fill(Store& store, TimePoint first, int minutes) {
    const CameraNumber camera = store.upsert_camera("quay", harbour());
    for (int i = 0; i < minutes; ++i) store.put(camera, foggy(first + std::chrono::minutes(i)));
    store.commit();
  }
  int count(const std::string& table) {
    return SQLite::Database(file.string()).execAndGet("SELECT count(*) FROM " + table).getInt();
  }

  TemporaryDirectory directory;
  std::filesystem::path file = directory / "lampglow.db";
};

TEST_F(MaintenanceTest, RetentionDropsWholeHoursAndNothingElse) {
  Store store(file);
  fill(store, at("2026-11-01T00:00:00Z"), 300);
  Retention retention;
  retention.frames_days = retention.fits_days = retention.one_minute_days = 1;
  retention.ring_profiles_days = 0;
  const TimePoint now = at("2026-11-02T02:30:00Z");  // a day ago: 02:30, so everything before 02:00 goes
  int rounds = 0;
  while (apply_retention(store, retention, now, 50) > 0) ++rounds;
  EXPECT_GT(rounds, 2);
  EXPECT_EQ(count("observation"), 180);
  EXPECT_EQ(count("frame"), 180);
  EXPECT_EQ(count("lamp_fit"), 360);
  EXPECT_EQ(count("ring_profile"), 300);
  EXPECT_EQ(Reader(file).span(1)->first, at("2026-11-01T02:00:00Z"));
  EXPECT_EQ(count("mean WHERE period_s = 600"), 31);
  EXPECT_EQ(count("mean WHERE period_s = 60 AND end_ms < 1793498400000"), 0);
}

// Each setting drops its own rows and no others.
TEST_F(MaintenanceTest, EveryKindOfRowHasItsOwnRetention) {
  const std::vector<std::pair<int Retention::*, std::vector<std::string>>> kinds = {
      {&Retention::frames_days, {"frame", "observation"}},
      {&Retention::fits_days, {"lamp_fit"}},
      {&Retention::ring_profiles_days, {"ring_profile"}},
      {&Retention::one_minute_days, {"mean WHERE period_s = 60"}},
      {&Retention::ten_minutes_days, {"mean WHERE period_s = 600"}},
      {&Retention::hours_days, {"mean WHERE period_s = 3600"}},
      {&Retention::events_days, {"event"}}};
  for (const auto& [setting, dropped] : kinds) {
    file = directory / (dropped.front() + ".db");
    Store store(file);
    fill(store, at("2026-11-01T00:00:30Z"), 180);
    for (int i = 0; i < 3; ++i)
      store.put_event({0, at("2026-11-01T00:10:00Z") + std::chrono::hours(i), EventKind::started,
                       Severity::info, "", "up"});
    std::map<std::string, int> before;
    for (const auto& [unused, tables] : kinds)
      for (const std::string& table : tables) before[table] = count(table);
    Retention only{0, 0, 0, 0, 0, 0, 0};
    only.*setting = 1;
    while (apply_retention(store, only, at("2026-11-02T02:30:00Z"), 50) > 0) {
    }
    for (const auto& [table, rows] : before) {
      const bool goes = std::find(dropped.begin(), dropped.end(), table) != dropped.end();
      if (goes) {
        EXPECT_LT(count(table), rows) << table;
        EXPECT_GT(count(table), 0) << table;
      } else {
        EXPECT_EQ(count(table), rows) << table << " with the retention of " << dropped.front();
      }
    }
  }
}

TEST_F(MaintenanceTest, AMeanOutlivesItsFramesEvenIfALateOneComes) {
  Store store(file);
  fill(store, at("2026-11-01T00:01:00Z"), 60);
  const double before = Reader(file).latest(1, 3600)->observation.extinction_per_m.value();
  while (store.drop_before(Kept::observations, at("2026-11-01T01:00:00Z"), 1000) > 0) {
  }
  store.put(1, foggy(at("2026-11-01T00:30:30Z"), 0.5));
  store.commit();
  EXPECT_EQ(Reader(file).latest(1, 3600)->observation.extinction_per_m.value(), before);
}

TEST_F(MaintenanceTest, ABackupIsASoundCopyWhileTheStoreIsInUse) {
  Store store(file);
  fill(store, at("2026-11-01T00:00:00Z"), 100);
  store.put(1, foggy(at("2026-11-02T00:00:00Z")));  // pending: not in the copy
  backup(file, directory / "copy.db");
  EXPECT_EQ(check(directory / "copy.db", true), "ok");
  EXPECT_FALSE(std::filesystem::exists(directory / "copy.db.part"));
  store.rollback();
  EXPECT_EQ(Reader(directory / "copy.db").content(), Reader(file).content());
}

// The copy is one moment of the database, however many commits come while it is made.
TEST_F(MaintenanceTest, ABackupHoldsItsMomentAgainstAWriterThatNeverRests) {
  Store store(file, {.batch_frames = 1});
  fill(store, at("2026-11-01T00:00:00Z"), 3000);
  std::jthread writer([&](const std::stop_token& stop) {
    for (int i = 0; !stop.stop_requested(); ++i)
      store.put(1, foggy(at("2026-11-10T00:00:00Z") + std::chrono::seconds(i)));
  });
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(backup(file, directory / "copy.db"));
  writer = {};
  EXPECT_EQ(check(directory / "copy.db", true), "ok");
  const auto frames = [&](const std::filesystem::path& of) {
    return SQLite::Database(of.string()).execAndGet("SELECT count(*) FROM frame").getInt();
  };
  EXPECT_GE(frames(directory / "copy.db"), 3000);
  EXPECT_GT(frames(file), frames(directory / "copy.db"));
}

TEST_F(MaintenanceTest, ABackupThatIsToldToStopLeavesNothing) {
  Store store(file);
  fill(store, at("2026-11-01T00:00:00Z"), 100);
  std::stop_source source;
  source.request_stop();
  EXPECT_FALSE(backup(file, directory / "copy.db", source.get_token()));
  for (const auto& entry : std::filesystem::directory_iterator(directory.path()))
    EXPECT_THAT(entry.path().filename().string(), testing::Not(testing::HasSubstr("copy")));
}

TEST_F(MaintenanceTest, ACheckpointWorksAtAnyMoment) {
  Store store(file);
  store.checkpoint();
  const CameraNumber camera = store.upsert_camera("quay", harbour());
  store.checkpoint();
  FrameResult frame = foggy(at("2026-11-01T00:00:00Z"));
  frame.lamps[0].id = "in no catalogue";
  store.put(camera, frame);
  store.checkpoint();
  EXPECT_EQ(std::filesystem::file_size(file.string() + "-wal"), 0u);
  EXPECT_EQ(count("observation"), 1);
}

TEST_F(MaintenanceTest, ACheckpointThatAReaderHoldsUpSaysSoAtOnce) {
  Store store(file, {.busy_timeout_ms = 20'000});
  fill(store, at("2026-11-01T00:00:00Z"), 10);
  EXPECT_TRUE(store.checkpoint());
  fill(store, at("2026-11-02T00:00:00Z"), 10);
  store.commit();
  {
    SQLite::Database reader(file.string());
    reader.exec("BEGIN");
    EXPECT_EQ(reader.execAndGet("SELECT count(*) FROM observation").getInt(), 20);
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_FALSE(store.checkpoint());
    EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
  }
  EXPECT_TRUE(store.checkpoint());
}

TEST_F(MaintenanceTest, ABackupThatFailsLeavesNothing) {
  {
    Store store(file);
    fill(store, at("2026-11-01T00:00:00Z"), 2000);
    EXPECT_TRUE(store.checkpoint());
  }
  // A page of the fits, which only a whole check of the copy finds.
  std::fstream damaged(file, std::ios::in | std::ios::out | std::ios::binary);
  damaged.seekp(static_cast<std::streamoff>(std::filesystem::file_size(file) / 4096 / 2 * 4096));
  damaged << std::string(4096, '\xff');
  damaged.close();
  const auto copies = directory / "copies";
  std::filesystem::create_directory(copies);
  EXPECT_THROW(backup(file, copies / "copy.db"), StorageError);
  EXPECT_TRUE(std::filesystem::is_empty(copies));
}

TEST_F(MaintenanceTest, ABackupThatDoesNotFitIsNotBegun) {
  if (geteuid() != 0) GTEST_SKIP() << "needs root for a small disk";
  const auto disk = directory / "disk";
  std::filesystem::create_directory(disk);
  if (::mount("tmpfs", disk.c_str(), "tmpfs", 0, "size=256k") != 0) GTEST_SKIP() << "no mount here";
  {
    Store store(file);
    fill(store, at("2026-11-01T00:00:00Z"), 2000);
    EXPECT_TRUE(store.checkpoint());
  }
  try {
    backup(file, disk / "copy.db");
    ADD_FAILURE() << "a copy of " << std::filesystem::file_size(file) << " bytes in 256 KiB";
  } catch (const StorageError& error) {
    EXPECT_EQ(error.kind(), StorageError::Kind::full);
    EXPECT_THAT(error.what(), testing::HasSubstr("MiB, of which 0 are free"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(disk));
  ::umount(disk.c_str());
}

TEST_F(MaintenanceTest, ADamagedPageIsFoundAndTheFileSetAsideWithAllThatIsInIt) {
  {
    Store store(file);
    fill(store, at("2026-11-01T00:00:00Z"), 400);
    store.checkpoint();
  }
  const auto size = std::filesystem::file_size(file);
  {
    std::fstream stream(file, std::ios::binary | std::ios::in | std::ios::out);
    stream.seekp(static_cast<std::streamoff>(size / 2));
    stream << std::string(8192, '\x5a');
  }
  std::string found;
  try {
    found = check(file, false);
  } catch (const StorageError& error) {
    found = error.what();
  }
  EXPECT_NE(found, "ok");
  EXPECT_NE(found, "");
  const auto aside = set_aside(file, at("2026-11-22T01:02:03Z"));
  EXPECT_EQ(aside.filename(), "lampglow.db.corrupt-20261122T010203Z");
  EXPECT_EQ(std::filesystem::file_size(aside), size);
  EXPECT_FALSE(std::filesystem::exists(file));
  Store fresh(file);
  fill(fresh, at("2026-11-22T01:00:00Z"), 1);
  EXPECT_EQ(check(file, true), "ok");
}

TEST_F(MaintenanceTest, RetentionKeepsTheFileFlat) {
  Store store(file);
  Retention retention;
  retention.frames_days = retention.fits_days = retention.one_minute_days = retention.ring_profiles_days = 1;
  retention.ten_minutes_days = retention.hours_days = 1;
  std::vector<std::uintmax_t> sizes;
  TimePoint now = at("2026-11-01T00:00:00Z");
  for (int day = 0; day < 8; ++day) {
    fill(store, now, 300);
    now += std::chrono::hours(24);
    while (apply_retention(store, retention, now) > 0) {
    }
    store.checkpoint();
    sizes.push_back(std::filesystem::file_size(file));
  }
  EXPECT_LE(sizes.back(), sizes[2] * 11 / 10);
  EXPECT_GT(sizes.back(), 0u);
}

}  // namespace
}  // namespace lampglow::storage
