#include "storage/schema.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>

#include "storage/maintenance.h"
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

std::string text_of(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

// A database as a program of that version left it: tests/storage/versions, dumped with sqlite3.
void restore_version(int version, const std::filesystem::path& file) {
  const std::string dump = text_of(std::filesystem::path(LAMPGLOW_SOURCE_DIR) / "tests/storage/versions" /
                                   ("v" + std::to_string(version) + ".sql"));
  ASSERT_FALSE(dump.empty()) << "version " << version << " has no file: tests/storage/versions/README.md";
  SQLite::Database(file.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(dump);
}

// Table by table the columns of `columns`, or those there are, and all rows of them.
using Columns = std::map<std::string, std::string>;
Columns columns_of(SQLite::Database& database) {
  Columns columns;
  SQLite::Statement rows(database,
                         "SELECT t.name, group_concat('quote(\"' || c.name || '\")', '||\",\"||') FROM "
                         "sqlite_master AS t, pragma_table_info(t.name) AS c WHERE t.type = 'table' AND "
                         "t.name NOT LIKE 'sqlite_%' GROUP BY t.name");
  while (rows.executeStep()) columns[rows.getColumn(0).getString()] = rows.getColumn(1).getString();
  return columns;
}
std::string rows_of(SQLite::Database& database, const Columns& columns) {
  std::string out;
  for (const auto& [table, names] : columns) {
    SQLite::Statement rows(database, "SELECT " + names + " FROM \"" + table + "\" ORDER BY 1");
    while (rows.executeStep()) (((out += table) += ": ") += rows.getColumn(0).getString()) += "\n";
  }
  return out;
}

// The numbers in the files of old programs still mean what they meant.
void expect_old_meanings(const std::filesystem::path& file, int version) {
  Reader reader(file);
  const auto quay = reader.camera("quay");
  ASSERT_TRUE(quay);
  const auto rows =
      reader.observations({quay->number, at("2026-11-22T01:00:00Z"), at("2026-11-22T02:00:00Z"), 0, {}, 100});
  const std::array<std::string, 6> weather{"unknown", "clear", "haze", "mist", "fog", "rain"};
  const std::array<std::string, 6> states{"unknown", "seen", "faded", "off", "hidden", "saturated"};
  const std::array<std::string, 3> limits{"", "above", "below"}, methods{"none", "glow", "contrast"};
  ASSERT_EQ(rows.size(), 6U);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Observation& o = rows[i].observation;
    EXPECT_EQ(o.extinction_per_m, 0.002 * static_cast<double>(i + 1));
    EXPECT_EQ(to_string(o.weather), weather[i]);
    EXPECT_EQ(to_string(o.limit), limits[i % 3]);
    EXPECT_EQ(to_string(o.method), methods[i % 3]);
    EXPECT_EQ(o.quality.to_string(), "few_lights");
    EXPECT_EQ(to_string(reader.fits(quay->number, o.time_utc).at(0).fit.state), states[i]);
  }
  EXPECT_EQ(reader.latest(quay->number, 3600)->observation.time_utc, at("2026-11-22T13:00:00Z"));
  EXPECT_EQ(reader.lamps(quay->number).at(0).distance_m, 62.5);
  EXPECT_EQ(reader.rings(quay->number, "L1")->second.theta_deg, (std::vector<double>{0.25, 0.5, 1}));
  const std::vector<std::string> kinds{
      "started",       "stopped",          "configuration_changed", "reference_learned",
      "source_failed", "source_recovered", "database_set_aside",    "backup_made",
      "backup_failed", "disk_full",        "clock_stepped",         "retention",
      "fog_began",     "fog_ended",        "database_recovered"};
  const auto events = reader.events(0, 100);
  ASSERT_EQ(events.size(), kinds.size());
  for (std::size_t i = 0; i < kinds.size(); ++i) EXPECT_EQ(to_string(events[i].kind), kinds[i]);
  if (version < 2) return;
  const auto pictures = reader.pictures("quay", TimePoint{}, at("2100-01-01T00:00:00Z"), 10);
  ASSERT_EQ(pictures.size(), 2U);
  EXPECT_EQ(to_string(pictures[0].kept_for), "hourly");
  EXPECT_EQ(to_string(pictures[1].kept_for), "fog_onset");
  if (version < 3) return;
  const auto references = ReferenceReader(file).references(quay->number);
  ASSERT_EQ(references.size(), 3U);
  EXPECT_EQ(to_string(references[0].origin), "clear_brackets");
  EXPECT_EQ(to_string(references[1].origin), "relearned");
  EXPECT_EQ(to_string(references[2].origin), "restored");
}

TEST(Schema, FilesOfEveryVersionAreMigratedWholeAndReadAsTheyWereMeant) {
  TemporaryDirectory directory;
  Store fresh(directory / "fresh.db");
  SQLite::Database expected((directory / "fresh.db").string());
  for (int version = 1; version <= schema_version(); ++version) {
    SCOPED_TRACE("version " + std::to_string(version));
    const auto file = directory / ("v" + std::to_string(version) + ".db");
    ASSERT_NO_FATAL_FAILURE(restore_version(version, file));
    Columns columns;
    std::string before;
    {
      SQLite::Database old(file.string());
      EXPECT_EQ(schema_version(old), version);
      columns = columns_of(old);
      before = rows_of(old, columns);
    }
    { Store store(file); }
    SQLite::Database migrated(file.string());
    EXPECT_EQ(schema_version(migrated), schema_version());
    EXPECT_EQ(schema_of(migrated), schema_of(expected));
    EXPECT_EQ(rows_of(migrated, columns), before);
    EXPECT_EQ(migrated.execAndGet("PRAGMA integrity_check").getString(), "ok");
    EXPECT_EQ(migrated.execAndGet("PRAGMA auto_vacuum").getInt(), 2);
    expect_old_meanings(file, version);
  }
}

TEST(Schema, AnOldCopyIsMigratedByHand) {
  TemporaryDirectory directory;
  const auto file = directory / "copy.db";
  ASSERT_NO_FATAL_FAILURE(restore_version(1, file));
  try {
    Reader reader(file);
    FAIL() << "read a database of version 1";
  } catch (const StorageError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("(schema version 1); `lampglow db vacuum` migrates it"));
  }
  vacuum(file);
  expect_old_meanings(file, 1);
}

TEST(Schema, ALaterProgramsDatabaseIsLeftAlone) {
  TemporaryDirectory directory;
  const auto file = directory / "later.db";
  { Store store(file); }
  { SQLite::Database(file.string(), SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 99"); }
  EXPECT_THROW(vacuum(file), StorageError);
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
