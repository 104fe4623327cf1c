// What takes long at a start is broken off when a stop is asked for, and the database is as whole as before.
#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>
#include <time.h>
#include <unistd.h>

#include <chrono>
#include <stop_token>
#include <thread>

#include "storage/maintenance.h"
#include "storage/reader.h"
#include "storage/schema.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using namespace testing_support;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

// While it lives, SQLite waits for every page that it reads, as on a worn card.
class SlowDisk {
 public:
  static constexpr auto kRead = 500us;
  SlowDisk() { set(reinterpret_cast<sqlite3_syscall_ptr>(&slow_pread)); }
  ~SlowDisk() { set(nullptr); }  // as it was
  SlowDisk(const SlowDisk&) = delete;
  SlowDisk& operator=(const SlowDisk&) = delete;

 private:
  static ssize_t slow_pread(int file, void* buffer, std::size_t size, off64_t offset) {
    std::this_thread::sleep_for(kRead);
    return ::pread64(file, buffer, size, offset);
  }
  static void set(sqlite3_syscall_ptr call) {
    sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
    ASSERT_EQ(vfs->xSetSystemCall(vfs, "pread64", call), SQLITE_OK);
  }
};

// How long `work` takes once it was told to stop, after `before`; it must throw StorageError::stopped.
template <typename Work>
std::chrono::duration<double> time_to_stop(std::chrono::duration<double> before, Work&& work) {
  std::stop_source source;
  Clock::time_point asked;
  std::jthread asking([&] {
    std::this_thread::sleep_for(before);
    asked = Clock::now();
    source.request_stop();
  });
  try {
    work(source.get_token());
    ADD_FAILURE() << "it came to its end";
  } catch (const StorageError& error) {
    EXPECT_EQ(error.kind(), StorageError::Kind::stopped) << error.what();
  }
  const auto ended = Clock::now();
  asking.join();
  return ended - asked;
}

template <typename Work>
std::chrono::duration<double> time_of(Work&& work) {
  const auto begin = Clock::now();
  work();
  return Clock::now() - begin;
}

// First all pages in one single step of SQLite's, then all rows.
TEST(BreakOff, ACheckOfADatabaseOnASlowDisk) {
  TemporaryDirectory directory;
  const auto file = directory / "lampglow.db";
  {
    Store store(file, {.batch_frames = 5000});
    const CameraNumber camera = store.upsert_camera("quay", harbour());
    for (int i = 0; i < 15000; ++i) store.put(camera, foggy(at("2026-11-01T00:00:00Z") + i * 60s));
  }
  const std::string before = Reader(file).content();
  {
    const SlowDisk slow;
    const auto whole = time_of([&] { EXPECT_EQ(check(file, false), "ok"); });
    ASSERT_GT(whole, 2s) << "too short to be broken off";
    for (const double part : {0.05, 0.3, 0.8})
      EXPECT_LT(time_to_stop(part * whole, [&](const auto& stop) { check(file, false, stop); }), 0.15 * whole)
          << part << " of " << whole.count() << " s";
  }
  EXPECT_EQ(check(file, true), "ok");
  EXPECT_EQ(Reader(file).content(), before);
}

// The tables that SQLite has to read again with every change of the schema make a migration long that is one
// of milliseconds else.
TEST(BreakOff, AMigrationIsRolledBackAndTheNextStartMakesIt) {
  constexpr int kOld = 3;
  TemporaryDirectory directory;
  const auto original = directory / "original.db", file = directory / "lampglow.db";
  {
    SQLite::Database old(original.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    migrate(old, kOld);
    SQLite::Transaction many(old);
    for (int i = 0; i < 8000; ++i)
      old.exec("CREATE TABLE other_" + std::to_string(i) +
               " (id INTEGER PRIMARY KEY, a REAL, b TEXT) STRICT");
    many.commit();
  }
  const auto afresh = [&] {
    for (const char* suffix : {"-wal", "-shm"}) std::filesystem::remove(file.string() + suffix);
    std::filesystem::copy_file(original, file, std::filesystem::copy_options::overwrite_existing);
  };
  const auto schema = [&] {
    SQLite::Database opened(file.string());
    SQLite::Statement rows(opened, "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name");
    std::string all = std::to_string(schema_version(opened));
    while (rows.executeStep()) all += rows.getColumn(0).getString();
    return all;
  };
  afresh();
  const std::string old_schema = schema();
  const auto whole = time_of([&] { Store store(file); });
  const std::string new_schema = schema();
  ASSERT_NE(old_schema, new_schema);
  for (const double part : {0.3, 0.6}) {
    afresh();
    EXPECT_LT(time_to_stop(part * whole, [&](const auto& stop) { Store store(file, {}, stop); }), 0.3 * whole)
        << part << " of " << whole.count() << " s";
    EXPECT_EQ(schema(), old_schema) << "half a migration";
    EXPECT_EQ(check(file, true), "ok");
    { Store store(file); }
    EXPECT_EQ(schema(), new_schema);
  }
}

TEST(BreakOff, AStopThatWasAskedForBeforeACheck) {
  TemporaryDirectory directory;
  { Store store(directory / "lampglow.db"); }
  std::stop_source source;
  source.request_stop();
  try {
    check(directory / "lampglow.db", false, source.get_token());
    FAIL() << "it came to its end";
  } catch (const StorageError& error) {
    EXPECT_EQ(error.kind(), StorageError::Kind::stopped) << error.what();
  }
}

}  // namespace
}  // namespace lampglow::storage
