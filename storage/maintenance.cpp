#include "storage/maintenance.h"

#include <SQLiteCpp/Backup.h>
#include <sqlite3.h>

#include <algorithm>
#include <array>
#include <system_error>

#include "storage/break_off.h"
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

void remove_part(const std::filesystem::path& part) {
  std::error_code ignored;
  for (const char* suffix : {"", "-wal", "-shm", "-journal"})
    std::filesystem::remove(part.string() + suffix, ignored);
}

// Under WAL a reader never stops the writer. One that did not hold its state would begin the copy afresh with
// every commit.
void copy_all(const std::filesystem::path& database, const std::filesystem::path& part,
              const std::stop_token& stop) {
  constexpr int kPages = 256;
  SQLite::Database source(database.string(), SQLite::OPEN_READONLY, 5000);
  SQLite::Transaction held(source);
  source.execAndGet("SELECT count(*) FROM sqlite_master");  // begins the read
  SQLite::Database target(part.string(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  SQLite::Backup copy(target, source);
  while (!stop.stop_requested() && copy.executeStep(kPages) != SQLITE_DONE) {
  }
}

// The check of a large copy takes as long as making it.
void check_copy(const std::filesystem::path& database, const std::filesystem::path& part,
                const std::stop_token& stop) {
  SQLite::Database copy(part.string(), SQLite::OPEN_READWRITE);
  copy.exec("PRAGMA journal_mode = DELETE");  // one file, no -wal beside it
  std::string found;
  until_stopped(copy, stop, "the check", [&] { found = checked(copy, true); });
  if (found != "ok")
    throw StorageError(StorageError::Kind::corrupt, database.string() + ": its copy is damaged: " + found);
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

bool backup(const std::filesystem::path& database, const std::filesystem::path& copy,
            const std::stop_token& stop) {
  const std::filesystem::path part = copy.string() + ".part";
  remove_part(part);
  try {
    guarded(copy.string(), [&] {
      copy_all(database, part, stop);
      check_copy(database, part, stop);
    });
  } catch (const StorageError&) {
    if (!stop.stop_requested()) throw;
  }
  if (stop.stop_requested()) {
    remove_part(part);
    return false;
  }
  std::error_code error;
  std::filesystem::rename(part, copy, error);
  if (error) throw StorageError(StorageError::Kind::io, copy.string() + ": " + error.message());
  return true;
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

std::string check(const std::filesystem::path& database, bool full, const std::stop_token& stop) {
  return guarded(database.string(), [&] {
    SQLite::Database opened(database.string(), SQLite::OPEN_READONLY, 5000);
    std::string found;
    until_stopped(opened, stop, "the check", [&] { found = checked(opened, full); });
    if (found == "ok" && schema_version(opened) > schema_version())
      throw StorageError(StorageError::Kind::too_new, database.string() + ": written by a later lampglow");
    return found;
  });
}

void vacuum(const std::filesystem::path& database) {
  guarded(database.string(), [&] {
    SQLite::Database opened(database.string(), SQLite::OPEN_READWRITE, 5000);
    migrate(opened);
    opened.exec("VACUUM");
    opened.exec("PRAGMA wal_checkpoint(TRUNCATE)");
  });
}

}  // namespace lampglow::storage
