// The nightly copies of the database.
#include "daemon/station/backups.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <future>
#include <optional>
#include <thread>

#include "storage/maintenance.h"
#include "storage/reader.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/support/temporary_folder.h"

namespace lampglow::daemon {
namespace {

using namespace testing_support;
using testing::ElementsAre;
using testing::HasSubstr;

class BackupsTest : public testing::Test {
 protected:
  struct Told {
    Backups::Result result{};
    std::string message;
  };

  void SetUp() override {
    storage::Store store(file);
    const auto camera = store.upsert_camera("quay", harbour());
    for (int i = 0; i < 20; ++i)
      store.put(camera, foggy(at("2026-11-22T00:00:00Z") + std::chrono::minutes(i)));
    store.commit();
  }

  // What the backup of this time says, which may take `patience`; empty: none is made.
  std::optional<Told> at_time(const char* time, std::chrono::seconds patience = std::chrono::seconds(20)) {
    std::promise<Told> told;
    Backups backups(file, copies, 2, 3, [&](Backups::Result result, const std::string& message, const auto&) {
      told.set_value({result, message});
    });
    backups.tick(at(time));
    backups.tick(at(time));  // a second look within the hour makes no second one
    auto future = told.get_future();
    if (future.wait_for(patience) != std::future_status::ready) return std::nullopt;
    return future.get();
  }

  std::vector<std::string> names() const {
    std::vector<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator(copies))
      found.push_back(entry.path().filename().string());
    std::sort(found.begin(), found.end());
    return found;
  }

  test::TemporaryFolder folder;
  std::filesystem::path file = folder.path() / "lampglow.db";
  std::filesystem::path copies = folder.path() / "backups";
};

TEST_F(BackupsTest, OneANightCheckedAndTheOldestGo) {
  EXPECT_FALSE(at_time("2026-11-22T02:59:59Z", std::chrono::seconds(1)));
  for (const char* time : {"2026-11-22T03:00:00Z", "2026-11-23T03:30:00Z", "2026-11-24T03:59:59Z"}) {
    const auto told = at_time(time);
    ASSERT_TRUE(told) << time;
    EXPECT_EQ(told->result, Backups::Result::good) << told->message;
  }
  EXPECT_THAT(names(), ElementsAre("lampglow-20261123.db", "lampglow-20261124.db"));
  EXPECT_EQ(storage::check(copies / "lampglow-20261124.db", true), "ok");
  EXPECT_EQ(storage::Reader(copies / "lampglow-20261124.db").content(), storage::Reader(file).content());
  EXPECT_FALSE(at_time("2026-11-24T03:10:00Z", std::chrono::seconds(1))) << "today's is there already";
}

// The station ends while a large copy is being made: it is not waited for, and nothing of it is left.
TEST_F(BackupsTest, OneThatIsBrokenOffEndsAtOnceAndLeavesNothing) {
  {
    storage::Store store(file, {.batch_frames = 5000});
    const auto camera = store.upsert_camera("quay", harbour());
    for (int i = 0; i < 20000; ++i)
      store.put(camera, foggy(at("2026-10-01T00:00:00Z") + std::chrono::minutes(i)));
  }
  const auto seconds = [](auto&& work) {
    const auto begin = std::chrono::steady_clock::now();
    work();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  const double whole_s = seconds([&] { storage::backup(file, folder.path() / "whole.db"); });
  bool told = false;
  for (const double part : {0.0, 0.3, 0.7}) {  // in the copy and in its check
    Backups backups(file, copies, 2, 3,
                    [&](Backups::Result, const std::string&, const auto&) { told = true; });
    backups.tick(at("2026-11-22T03:00:00Z") + std::chrono::hours(24 * static_cast<int>(10 * part)));
    std::this_thread::sleep_for(std::chrono::duration<double>(part * whole_s));
    EXPECT_LT(seconds([&] { backups.stop(); }), 0.2 * whole_s + 0.1) << "of " << whole_s << " s";
    EXPECT_FALSE(told);
    EXPECT_TRUE(!std::filesystem::exists(copies) || names().empty());
  }
}

TEST_F(BackupsTest, ADamagedDatabaseIsToldAsThat) {
  std::filesystem::resize_file(file, 5000);  // within its second page
  const auto told = at_time("2026-11-22T03:00:00Z");
  ASSERT_TRUE(told);
  EXPECT_EQ(told->result, Backups::Result::damaged) << told->message;
  EXPECT_THAT(names(), testing::IsEmpty());
}

TEST_F(BackupsTest, WhatCannotBeMadeIsToldAndTheDatabaseIsNotBlamed) {
  std::ofstream(folder.path() / "backups") << "a file where the folder should be";
  const auto told = at_time("2026-11-22T03:00:00Z");
  ASSERT_TRUE(told);
  EXPECT_EQ(told->result, Backups::Result::failed);
  EXPECT_THAT(told->message, HasSubstr("the backup failed"));
}

TEST_F(BackupsTest, WhatAPowerCutLeftGoesWithTheNextBackup) {
  std::filesystem::create_directory(copies);
  std::ofstream(copies / "lampglow-20261121.db.part") << "half a copy";
  std::ofstream(copies / "lampglow-20261121.db.part-journal") << "of it";
  std::ofstream(copies / "note.txt") << "not ours";
  ASSERT_TRUE(at_time("2026-11-22T03:00:00Z"));
  EXPECT_THAT(names(), ElementsAre("lampglow-20261122.db", "note.txt"));
}

}  // namespace
}  // namespace lampglow::daemon
