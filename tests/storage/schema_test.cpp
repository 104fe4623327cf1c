#include "storage/schema.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <regex>
#include <sstream>

#include "storage/reader.h"
#include "storage/references.h"
#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"

namespace lampglow::storage {
namespace {

using testing_support::at;
using testing_support::TemporaryDirectory;

std::string schema_of(SQLite::Database& database) {
  std::string out;
  SQLite::Statement rows(database, "SELECT sql FROM sqlite_master WHERE sql IS NOT NULL ORDER BY name");
  while (rows.executeStep()) out += rows.getColumn(0).getString() + "\n";
  return out;
}

// In the source and in the database itself, where `.schema` shows it.
TEST(Schema, EveryColumnHasAComment) {
  TemporaryDirectory directory;
  Store fresh(directory / "fresh.db");
  SQLite::Database database((directory / "fresh.db").string());
  const std::string stored = schema_of(database);
  int columns = 0;
  for (const char* step : migrations()) {
    std::istringstream lines(step);
    const std::regex column(R"(^  [a-z_0-9]+ (INTEGER|REAL|TEXT|BLOB).*)");
    const std::regex comment(R"((-- .+|/\* .+ \*/))");
    for (std::string line; std::getline(lines, line);) {
      if (!std::regex_match(line, column)) continue;
      ++columns;
      std::smatch found;
      ASSERT_TRUE(std::regex_search(line, found, comment)) << line;
      EXPECT_NE(stored.find(found.str()), std::string::npos) << line;
    }
  }
  EXPECT_GT(columns, 80);
}

// From every earlier version, with rows in it, to the present one: the same tables as a fresh database, and
// no row lost.
TEST(Schema, MigratesFromEveryEarlierVersion) {
  TemporaryDirectory directory;
  Store fresh(directory / "fresh.db");
  SQLite::Database expected((directory / "fresh.db").string());
  for (int version = 1; version <= schema_version(); ++version) {
    const auto file = directory / ("v" + std::to_string(version) + ".db");
    {
      SQLite::Database old(file.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
      migrate(old, version);
      old.exec("INSERT INTO station (id, name) VALUES (1, 'harbour')");
      old.exec("INSERT INTO camera (id, station_id, name) VALUES (7, 1, 'quay')");
      old.exec(
          "INSERT INTO observation (camera_id, time_ms, extinction_per_m, limit_kind, weather, method, "
          "lights_used, quality) VALUES (7, 1000, 0.5, 0, 4, 1, 3, 0)");
      old.exec("INSERT INTO lamp (id, camera_id, name) VALUES (3, 7, 'L1')");
      old.exec(
          "INSERT INTO lamp_fit (camera_id, time_ms, lamp_id, state, x_px, y_px, strength_ratio) VALUES (7, "
          "1000, 3, 1, 5, 6, 0.75)");
      if (version >= 3) {
        old.exec(
            "INSERT INTO reference (id, camera_id, valid_from_ms, origin, base_ms, frames, hours) VALUES (5, "
            "7, 900, 2, 800, 12, 3)");
        old.exec(
            "INSERT INTO reference_lamp (reference_id, name, strength, ln_relearned) VALUES (5, 'L1', 40, "
            "-0.1)");
      }
      EXPECT_EQ(schema_version(old), version);
    }
    Store store(file);
    SQLite::Database migrated(file.string());
    EXPECT_EQ(schema_version(migrated), schema_version());
    EXPECT_EQ(schema_of(migrated), schema_of(expected)) << "from version " << version;
    const auto row = Reader(file).latest(7);
    ASSERT_TRUE(row);
    EXPECT_EQ(row->observation.extinction_per_m, 0.5);
    EXPECT_EQ(row->observation.weather, Weather::fog);
    const auto fits = Reader(file).fits(7, {});
    ASSERT_EQ(fits.size(), 1U);
    EXPECT_EQ(fits[0].fit.strength_ratio, 0.75);
    EXPECT_FALSE(fits[0].fit.ln_halo);
    if (version < 3) continue;
    const auto reference = ReferenceReader(file).reference(7);
    ASSERT_TRUE(reference);
    EXPECT_EQ(reference->frames, 12);
    EXPECT_EQ(reference->halo_frames, 0);
    ASSERT_EQ(reference->lamps.size(), 1U);
    EXPECT_EQ(reference->lamps[0].ln_relearned, -0.1);
    EXPECT_EQ(reference->lamps[0].ln_halo, 0) << "an even lamp's";
    EXPECT_FALSE(reference->lamps[0].halo_utc);
  }
}

TEST(Schema, ALaterProgramsDatabaseIsLeftAlone) {
  TemporaryDirectory directory;
  const auto file = directory / "later.db";
  { Store store(file); }
  { SQLite::Database(file.string(), SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 99"); }
  try {
    Store store(file);
    FAIL() << "opened a database of version 99";
  } catch (const StorageError& error) {
    EXPECT_EQ(error.kind(), StorageError::Kind::too_new);
    EXPECT_THAT(error.what(), testing::HasSubstr("schema version 99 was written by a later lampglow"));
  }
}

TEST(Schema, AFileThatIsNoDatabaseIsCorrupt) {
  TemporaryDirectory directory;
  const auto file = directory / "text.db";
  std::ofstream(file)
      << "this is not a database, whatever its name says; it is long enough to have a header ......";
  try {
    Store store(file);
    FAIL();
  } catch (const StorageError& error) {
    EXPECT_EQ(error.kind(), StorageError::Kind::corrupt) << error.what();
  }
}

}  // namespace
}  // namespace lampglow::storage
