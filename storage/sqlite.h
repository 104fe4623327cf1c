// Small helpers over SQLiteCpp. Included by this folder's .cpp files only.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <filesystem>
#include <optional>
#include <string>

#include "estimator/time.h"
#include "storage/error.h"

namespace lampglow::storage {

// What SQLite's error number asks of the caller.
StorageError::Kind kind_of(const SQLite::Exception& error);

// Runs `work`; what SQLite throws comes out as StorageError with the file's name.
template <typename Work>
auto guarded(const std::string& file, Work&& work) {
  try {
    return work();
  } catch (const SQLite::Exception& error) {
    throw StorageError(kind_of(error), file + ": " + error.what());
  }
}

inline std::int64_t to_ms(TimePoint time) {
  return time.time_since_epoch().count();
}
inline TimePoint from_ms(std::int64_t ms) {
  return TimePoint{std::chrono::milliseconds{ms}};
}

// Binds the statement's parameters one after the other; an empty optional is NULL.
class Binder {
 public:
  explicit Binder(SQLite::Statement& statement) : statement_(statement) {}
  Binder& operator<<(std::int64_t value) { return put(value); }
  Binder& operator<<(int value) { return put(value); }
  Binder& operator<<(double value) { return put(value); }
  Binder& operator<<(const std::string& value) { return put(value); }
  template <typename T>
  Binder& operator<<(const std::optional<T>& value) {
    if (value) return *this << *value;
    statement_.bind(++index_);
    return *this;
  }

 private:
  template <typename T>
  Binder& put(const T& value) {
    statement_.bind(++index_, value);
    return *this;
  }
  SQLite::Statement& statement_;
  int index_ = 0;
};

// Reads a row's columns one after the other.
class RowReader {
 public:
  explicit RowReader(SQLite::Statement& row) : row_(row) {}
  std::int64_t integer() { return row_.getColumn(index_++).getInt64(); }
  int small() { return row_.getColumn(index_++).getInt(); }
  double real() { return row_.getColumn(index_++).getDouble(); }
  std::string text() { return row_.getColumn(index_++).getString(); }
  std::optional<double> maybe_real() {
    return row_.isColumnNull(index_) ? (++index_, std::nullopt) : std::optional<double>(real());
  }
  std::optional<int> maybe_small() {
    return row_.isColumnNull(index_) ? (++index_, std::nullopt) : std::optional<int>(small());
  }
  std::optional<std::int64_t> maybe_integer() {
    return row_.isColumnNull(index_) ? (++index_, std::nullopt) : std::optional<std::int64_t>(integer());
  }
  bool null() const { return row_.isColumnNull(index_); }
  SQLite::Column column() { return row_.getColumn(index_++); }

 private:
  SQLite::Statement& row_;
  int index_ = 0;
};

}  // namespace lampglow::storage
