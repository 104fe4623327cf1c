// The database's tables and how an older database becomes a newer one. Files of this folder only.
#pragma once

#include <span>
#include <stop_token>

namespace SQLite {
class Database;
}

namespace lampglow::storage {

// Step i brings a database from user_version i to i + 1. Steps are never edited once released; new ones are
// added at the end.
std::span<const char* const> migrations();

int schema_version();
int schema_version(SQLite::Database& database);

// Runs what is missing up to `target`, each step in a transaction of its own. Throws StorageError::too_new
// for a database of a later program. Throws soon after a stop was asked for: the step that ran is rolled
// back, those before it stay, and the next call goes on from there.
void migrate(SQLite::Database& database, int target = schema_version(), const std::stop_token& stop = {});

}  // namespace lampglow::storage
