// Years without care: what is dropped, copied, checked and set aside.
#pragma once

#include <filesystem>
#include <optional>
#include <stop_token>
#include <string>

#include "storage/store.h"

namespace lampglow::storage {

// How many days each kind of row is kept; 0: for ever.
struct Retention {
  int frames_days = 400;  // frames and observations
  int fits_days = 400;
  int ring_profiles_days = 2;
  int one_minute_days = 400;
  int ten_minutes_days = 0;
  int hours_days = 0;
  int events_days = 400;
};

// Drops up to `max_rows` rows (of each kind and camera) that are older than the retention allows, whole hours
// only, and gives free pages back to the file system. Returns how many rows went; call again while it is not
// 0.
int apply_retention(Store& store, const Retention& retention, TimePoint now, int max_rows = 2000);

// A copy of a database that may be in use: by the backup API to `copy`.part, PRAGMA integrity_check on it,
// then renamed to `copy`. Throws StorageError; `full` before it begins if there is no room for it, `corrupt`
// if the copy does not pass. False: it was told to stop. Without a copy nothing of it is left.
bool backup(const std::filesystem::path& database, const std::filesystem::path& copy,
            const std::stop_token& stop = {});

// Renames the database and its -wal and -shm to NAME.corrupt-20261122T010203Z...; nothing is deleted. Returns
// the new name. Throws StorageError if it cannot be renamed.
std::filesystem::path set_aside(const std::filesystem::path& database, TimePoint now);

// Renames what is left of the -wal and -shm of a database whose file is gone or another one by now, to
// NAME.replaced-20261122T010203Z-wal...
void set_wal_aside(const std::filesystem::path& database, TimePoint now);

// PRAGMA quick_check or integrity_check: "ok", or what is wrong. Opens the file for itself. Throws
// StorageError where it cannot even be opened; `stopped` soon after a stop was asked for.
std::string check(const std::filesystem::path& database, bool full, const std::stop_token& stop = {});

// VACUUM: rewrites the file, migrated if it is an older one. Needs its size once more on the disk; waits for
// no writer.
void vacuum(const std::filesystem::path& database);

}  // namespace lampglow::storage
