// The keeper of the database: the one writer, with everything that can go wrong with a disk. Used by one
// thread.
#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "daemon/station/config.h"
#include "daemon/station/retention_clock.h"
#include "storage/file_id.h"
#include "storage/maintenance.h"
#include "storage/references.h"
#include "storage/store.h"

namespace lampglow::daemon {

// What the keeper tells the rest of the station.
struct KeeperCallbacks {
  std::function<void(const storage::Event&)> on_event;     // it is stored, too
  std::function<void(const std::string& fault)> on_fault;  // the database can't be written; empty: it can
  std::function<void(std::chrono::seconds)> on_long_step;  // what comes may take up to so long; 0: over
  std::function<void(const storage::FileId&)> on_open;     // this is the database's file from now on
};

class Keeper {
 public:
  // Opens the database: one that is damaged is set aside, one that cannot be opened is tried again at every
  // tick. Throws StorageError::too_new, and `stopped` soon after `stop` asked for it; nothing else.
  Keeper(std::filesystem::path database, storage::Retention retention, std::chrono::seconds checkpoint_every,
         KeeperCallbacks callbacks, const std::stop_token& stop = {});
  ~Keeper();

  void add_camera(const std::string& name, const Site& site);
  void set_retention(const storage::Retention& retention) { retention_ = retention; }
  void set_checkpoint_every(std::chrono::seconds period) { checkpoint_every_ = period; }

  // Stores the result, or keeps it in memory until the disk takes it again (the last kMostWaiting).
  void put(const std::string& camera, FrameResult result);
  void put_event(storage::Event event);  // the last kMostWaiting wait, too
  // The camera's reference from now on. A fresh database gets it, too.
  void put_reference(const std::string& camera, const storage::ReferenceRecord& reference);
  void put_picture(const std::string& camera, const storage::PictureRecord& picture);
  void erase_picture(const storage::PictureRecord& picture);

  // A check has found this in the file: it is set aside, and a fresh one begun, unless that has happened
  // meanwhile.
  void set_aside_damaged(const storage::FileId& file, const std::string& found);
  // From any thread: the check of a file that takes the place of another one is not waited for. Then it stays
  // closed.
  void request_stop() { stop_.request_stop(); }

  // About once a second: retries, checkpoint, retention, the file's presence.
  void tick(TimePoint utc, std::chrono::steady_clock::time_point now);
  // Stores what waits and syncs, as far as the disk allows.
  void close();

  bool is_open() const { return store_ != nullptr; }
  std::size_t waiting() const { return waiting_.size(); }
  std::uint64_t lost() const { return lost_; }  // in a fault that lasts

  static constexpr std::size_t kMostWaiting = 2000;

 private:
  struct Waiting {
    std::string camera;
    FrameResult result;
  };
  void open(TimePoint utc);  // while the station runs
  void open_file(TimePoint utc, const std::stop_token& stop);
  void open_fresh_if_damaged(TimePoint utc, const std::stop_token& stop);
  void start_afresh(TimePoint utc, const std::string& why, bool set_aside_first);
  void drain();
  storage::CameraNumber number_of(storage::Store& store, const std::string& camera);
  // Runs `work` on the open store; what goes wrong is dealt with. False: it was not done.
  bool attempt(const std::function<void(storage::Store&)>& work);
  void failed(const storage::StorageError& error);
  void add_event(storage::Event event);
  void report(storage::EventKind kind, storage::Severity severity, const std::string& message);
  bool file_is_ours() const;
  void start_with_another_file(TimePoint utc);
  bool drop_what_is_old(TimePoint utc, std::chrono::steady_clock::time_point now);

  std::filesystem::path file_;
  storage::Retention retention_;
  std::chrono::seconds checkpoint_every_;
  KeeperCallbacks callbacks_;
  std::unique_ptr<storage::Store> store_;
  std::map<std::string, Site> sites_;
  std::map<std::string, storage::CameraNumber> numbers_;
  std::deque<Waiting> waiting_;
  std::deque<storage::Event> events_;  // not stored yet
  std::map<std::string, storage::ReferenceRecord> in_force_;
  std::deque<std::pair<std::string, storage::ReferenceRecord>> references_;  // not stored yet
  std::string fault_;
  TimePoint utc_{};
  std::chrono::steady_clock::time_point next_try_{}, next_checkpoint_{}, next_retention_{}, next_look_{};
  RetentionClock retention_clock_;
  bool told_of_lag_ = false;
  std::uint64_t lost_ = 0;               // since the fault began
  std::optional<storage::FileId> ours_;  // of the open file
  bool wal_is_anothers_ = false;         // what lies beside the file is of the one before it
  std::stop_source stop_;
};

}  // namespace lampglow::daemon
