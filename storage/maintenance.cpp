#include "storage/maintenance.h"

#include <SQLiteCpp/Backup.h>

#include <algorithm>
#include <array>
#include <system_error>

#include "storage/schema.h"
#include "storage/sqlite.h"

namespace lampglow::storage {
namespace {

std::string checked(SQLite::Database& database, bool full) {
  SQLite::Statement pragma(database, full ? "PRAGMA integrity_check" : "PRAGMA quick_check");
  std::string out;
  while (pragma.executeStep()) {
    if (!out.empty()) out += '\n';
    out += pragma.getColumn(0).getString();
  }
  return out;
}

std::string stamp(TimePoint time) {
  std::string text = format_time_utc(std::chrono::floor<std::chrono::seconds>(time));
  text.erase(std::remove_if(text.begin(), text.end(), [](char c) { return c == '-' || c == ':'; }),
             text.end());
  return text;
}

// The start of the hour so many days ago; empty: for ever.
std::optional<TimePoint> limit_of(int days, TimePoint now) {
  if (days <= 0) return std::nullopt;
  return std::chrono::floor<std::chrono::hours>(now - std::chrono::hours(24) * days);
}

}  // namespace

int apply_retention(Store& store, const Retention& retention, TimePoint now, int max_rows) {
  const std::array<std::pair<Kept, int>, 8> kinds = {{{Kept::frames, retention.frames_days},
                                                      {Kept::observations, retention.frames_days},
                                                      {Kept::fits, retention.fits_days},
                                                      {Kept::ring_profiles, retention.ring_profiles_days},
                                                      {Kept::one_minute, retention.one_minute_days},
                                                      {Kept::ten_minutes, retention.ten_minutes_days},
                                                      {Kept::hours, retention.hours_days},
                                                      {Kept::events, retention.events_days}}};
  int dropped = 0;
  for (const auto& [kind, days] : kinds)
    if (const auto limit = limit_of(days, now)) dropped += store.drop_before(kind, *limit, max_rows);
  if (dropped) store.release_pages(max_rows);
  return dropped;
}

void backup(const std::filesystem::path& database, const std::filesystem::path& copy) {
  const std::filesystem::path part = copy.string() + ".part";
  guarded(copy.string(), [&] {
    std::error_code ignored;
    std::filesystem::remove(part, ignored);
    std::filesystem::remove(part.string() + "-wal", ignored);
    std::filesystem::remove(part.string() + "-shm", ignored);
    SQLite::Database source(database.string(), SQLite::OPEN_READONLY, 5000);
    SQLite::Database target(part.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    // All at once: under WAL a reader never stops the writer, and a copy in steps would start afresh with
    // every commit.
    SQLite::Backup(target, source).executeStep(-1);
    target.exec("PRAGMA journal_mode = DELETE");  // one file, no -wal beside it
    if (const std::string found = checked(target, true); found != "ok")
      throw StorageError(StorageError::Kind::corrupt, database.string() + ": its copy is damaged: " + found);
  });
  std::error_code error;
  std::filesystem::rename(part, copy, error);
  if (error) throw StorageError(StorageError::Kind::io, copy.string() + ": " + error.message());
}

std::filesystem::path set_aside(const std::filesystem::path& database, TimePoint now) {
  std::filesystem::path aside = database.string() + ".corrupt-" + stamp(now);
  for (int i = 2; std::filesystem::exists(aside); ++i)
    aside = database.string() + ".corrupt-" + stamp(now) + "-" + std::to_string(i);
  for (const char* suffix : {"-wal", "-shm", ""}) {
    std::error_code error;
    const std::filesystem::path from = database.string() + suffix;
    if (!std::filesystem::exists(from)) continue;
    std::filesystem::rename(from, aside.string() + suffix, error);
    if (error) throw StorageError(StorageError::Kind::io, from.string() + ": " + error.message());
  }
  return aside;
}

std::string check(const std::filesystem::path& database, bool full) {
  return guarded(database.string(), [&] {
    SQLite::Database opened(database.string(), SQLite::OPEN_READONLY, 5000);
    std::string found = checked(opened, full);
    if (found == "ok" && schema_version(opened) > schema_version())
      throw StorageError(StorageError::Kind::too_new, database.string() + ": written by a later lampglow");
    return found;
  });
}

void vacuum(const std::filesystem::path& database) {
  guarded(database.string(), [&] {
    SQLite::Database opened(database.string(), SQLite::OPEN_READWRITE, 5000);
    opened.exec("VACUUM");
    opened.exec("PRAGMA wal_checkpoint(TRUNCATE)");
  });
}

}  // namespace lampglow::storage
