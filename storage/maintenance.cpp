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

constexpr std::size_t kLongestFinding = 200;  // of what a check says of each page, in a message

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

// NAME.WHY-20261122T010203Z, with a number behind it where that is taken.
std::filesystem::path unused_name(const std::filesystem::path& database, const std::string& why,
                                  TimePoint now) {
  const std::string first = database.string() + "." + why + "-" + stamp(now);
  std::string name = first;
  std::error_code unknown;
  for (int i = 2; std::filesystem::exists(name, unknown) || std::filesystem::exists(name + "-wal", unknown);
       ++i)
    name = first + "-" + std::to_string(i);
  return name;
}

void move_if_there(const std::filesystem::path& from, const std::filesystem::path& to) {
  std::error_code error;
  std::filesystem::rename(from, to, error);
  if (error && error != std::errc::no_such_file_or_directory)
    throw StorageError(StorageError::Kind::io, from.string() + ": " + error.message());
}

void remove_part(const std::filesystem::path& part) {
  std::error_code ignored;
  for (const char* suffix : {"", "-wal", "-shm", "-journal"})
    std::filesystem::remove(part.string() + suffix, ignored);
}

// A copy that does not fit would take the writer's room, too. A tenth is left for what is written meanwhile.
void needs_room(const std::filesystem::path& database, const std::filesystem::path& copy) {
  std::error_code unknown;
  const std::uintmax_t size = std::filesystem::file_size(database, unknown);
  if (unknown) return;  // opening it says why
  const std::filesystem::path folder = copy.has_parent_path() ? copy.parent_path() : ".";
  const std::filesystem::space_info space = std::filesystem::space(folder, unknown);
  if (unknown || space.available >= size + size / 10) return;
  throw StorageError(StorageError::Kind::full,
                     copy.string() + ": a copy needs " + std::to_string((size + size / 10) >> 20) +
                         " MiB, of which " + std::to_string(space.available >> 20) + " are free");
}

void publish(const std::filesystem::path& part, const std::filesystem::path& copy) {
  std::error_code error;
  std::filesystem::rename(part, copy, error);
  if (error) throw StorageError(StorageError::Kind::io, copy.string() + ": " + error.message());
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
    throw StorageError(StorageError::Kind::corrupt,
                       database.string() + ": its copy is damaged: " + found.substr(0, kLongestFinding));
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
    needs_room(database, copy);
    guarded(copy.string(), [&] {
      copy_all(database, part, stop);
      check_copy(database, part, stop);
    });
    if (!stop.stop_requested()) publish(part, copy);
  } catch (const StorageError&) {
    remove_part(part);  // a disk that is full must not stay so
    if (!stop.stop_requested()) throw;
  }
  remove_part(part);
  return !stop.stop_requested();
}

std::filesystem::path set_aside(const std::filesystem::path& database, TimePoint now) {
  std::filesystem::path aside = unused_name(database, "corrupt", now);
  for (const char* suffix : {"-wal", "-shm", ""})
    move_if_there(database.string() + suffix, aside.string() + suffix);
  return aside;
}

void set_wal_aside(const std::filesystem::path& database, TimePoint now) {
  const std::filesystem::path aside = unused_name(database, "replaced", now);
  for (const char* suffix : {"-wal", "-shm"})
    move_if_there(database.string() + suffix, aside.string() + suffix);
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
