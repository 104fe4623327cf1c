// Long work of the database that is not waited for once a stop is asked for. This folder's .cpp files only.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <functional>
#include <stop_token>
#include <string>

namespace lampglow::storage {

// Does `work` with this connection. Soon after a stop was asked for, before or within, it throws
// StorageError::stopped: "FILE: WHAT was broken off". Then a transaction is to be rolled back, and what a
// check has found means nothing.
void until_stopped(SQLite::Database& database, const std::stop_token& stop, const std::string& what,
                   const std::function<void()>& work);

}  // namespace lampglow::storage
