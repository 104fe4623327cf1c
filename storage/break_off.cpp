#include "storage/break_off.h"

#include <sqlite3.h>

#include "storage/error.h"

namespace lampglow::storage {
namespace {

struct Interrupt {
  sqlite3* connection;
  void operator()() const { sqlite3_interrupt(connection); }
};

// While it lives, a stop makes what the connection does end with SQLITE_INTERRUPT. Two ways are needed. The
// progress handler is asked every so many instructions, however early the stop came; but the check of all
// pages is one single instruction, which for a large file on a slow disk takes minutes, and within it SQLite
// 3.40 heeds nothing but sqlite3_interrupt().
class BreakOff {
 public:
  BreakOff(sqlite3* connection, const std::stop_token& stop)
      : connection_(connection), stop_(stop), interrupt_(stop, Interrupt{connection}) {
    constexpr int kInstructions = 10000;
    const auto stopped = [](void* token) -> int {
      return static_cast<std::stop_token*>(token)->stop_requested();
    };
    sqlite3_progress_handler(connection_, kInstructions, stopped, &stop_);
  }
  ~BreakOff() { sqlite3_progress_handler(connection_, 0, nullptr, nullptr); }
  BreakOff(const BreakOff&) = delete;
  BreakOff& operator=(const BreakOff&) = delete;

 private:
  sqlite3* connection_;
  std::stop_token stop_;
  std::stop_callback<Interrupt> interrupt_;  // called by the thread that asks for the stop
};

}  // namespace

void until_stopped(SQLite::Database& database, const std::stop_token& stop, const std::string& what,
                   const std::function<void()>& work) {
  try {
    const BreakOff break_off(database.getHandle(), stop);
    if (!stop.stop_requested()) work();
  } catch (const SQLite::Exception&) {
    if (!stop.stop_requested()) throw;
  }
  if (stop.stop_requested())
    throw StorageError(StorageError::Kind::stopped, database.getFilename() + ": " + what + " was broken off");
}

}  // namespace lampglow::storage
