#include "storage/sqlite.h"

#include <sqlite3.h>

namespace lampglow::storage {

StorageError::Kind kind_of(const SQLite::Exception& error) {
  switch (error.getErrorCode() & 0xff) {
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
      return StorageError::Kind::corrupt;
    case SQLITE_FULL:
      return StorageError::Kind::full;
    case SQLITE_READONLY:
      return StorageError::Kind::read_only;
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return StorageError::Kind::busy;
    default:
      return StorageError::Kind::io;
  }
}

}  // namespace lampglow::storage
