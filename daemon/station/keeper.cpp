#include "daemon/station/keeper.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "daemon/station/log.h"
#include "storage/reader.h"

namespace lampglow::daemon {
namespace {

using storage::Event;
using storage::EventKind;
using storage::Severity;
using storage::StorageError;
using storage::Store;

constexpr std::chrono::seconds kRetry{10};
constexpr std::chrono::minutes kRetentionEvery{5};
constexpr std::chrono::seconds kLookEvery{5};
constexpr std::chrono::seconds kCheckpointRetry{5};
constexpr std::chrono::hours kWorthATelling{48};  // that retention lags by

// Every frame is committed at once: a killed process loses nothing, a power cut what came since the
// checkpoint.
constexpr storage::StoreOptions kLive{.batch_frames = 1};

// How long a check and a migration of a file of this size may take: a page may be a seek of a slow disk.
std::chrono::seconds longest_check(const std::filesystem::path& file) {
  std::error_code none;
  const std::uintmax_t bytes = std::filesystem::file_size(file, none);
  return std::chrono::seconds(120 + (none ? 0 : bytes >> 19));  // 0.5 MiB/s
}

// Tells the watchdog's keeper of a step that may take long, and of its end however it ends.
class LongStep {
 public:
  LongStep(const std::function<void(std::chrono::seconds)>& tell, std::chrono::seconds at_most)
      : tell_(tell) {
    tell_(at_most);
  }
  ~LongStep() { tell_(std::chrono::seconds(0)); }
  LongStep(const LongStep&) = delete;
  LongStep& operator=(const LongStep&) = delete;

 private:
  const std::function<void(std::chrono::seconds)>& tell_;
};

// What retention begins with; empty if nothing is stored.
std::optional<TimePoint> newest_to_trust(const std::filesystem::path& file) {
  storage::Reader reader(file);
  std::optional<TimePoint> newest;
  for (const storage::CameraRecord& camera : reader.cameras())
    if (const auto time = reader.newest_of_a_day(camera.number))
      newest = std::max(newest.value_or(TimePoint::min()), *time);
  return newest;
}

}  // namespace

Keeper::Keeper(std::filesystem::path database, storage::Retention retention,
               std::chrono::seconds checkpoint_every, KeeperCallbacks callbacks, const std::stop_token& stop)
    : file_(std::move(database)),
      retention_(retention),
      checkpoint_every_(checkpoint_every),
      callbacks_(std::move(callbacks)) {
  utc_ = std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
  try {
    open_file(utc_, stop);
  } catch (const StorageError& error) {
    using Kind = StorageError::Kind;
    if (error.kind() == Kind::too_new || error.kind() == Kind::stopped) throw;
    store_.reset();
    failed(error);
  }
}

Keeper::~Keeper() = default;

void Keeper::report(EventKind kind, Severity severity, const std::string& message) {
  log(severity == Severity::info      ? LogLevel::info
      : severity == Severity::warning ? LogLevel::warning
                                      : LogLevel::error,
      message, {{"event", std::string(to_string(kind))}});
  add_event({0, utc_, kind, severity, "", message});
}

// A disk that fails for weeks must not fill the memory with what happened in them.
void Keeper::add_event(Event event) {
  events_.push_back(std::move(event));
  if (events_.size() > kMostWaiting) events_.pop_front();
}

bool Keeper::file_is_ours() const {
  return storage::file_id(file_) == ours_;
}

// A damaged file is one that SQLite cannot open or whose quick_check finds something.
void Keeper::open_fresh_if_damaged(TimePoint utc, const std::stop_token& stop) {
  std::error_code unknown;
  if (!std::filesystem::exists(file_, unknown)) return;
  std::string found;
  try {
    found = storage::check(file_, false, stop);
  } catch (const StorageError& error) {
    if (error.kind() != StorageError::Kind::corrupt) throw;
    found = error.what();
  }
  if (found == "ok") return;
  const auto aside = storage::set_aside(file_, utc);
  report(EventKind::database_set_aside, Severity::error,
         "the database is damaged (" + found.substr(0, 200) + "); it is kept as " +
             aside.filename().string() + " and the station goes on with a fresh one");
}

void Keeper::open_file(TimePoint utc, const std::stop_token& stop) {
  std::error_code ignored;
  std::filesystem::create_directories(file_.parent_path(), ignored);
  if (wal_is_anothers_) storage::set_wal_aside(file_, utc);
  wal_is_anothers_ = false;
  const LongStep step(callbacks_.on_long_step, longest_check(file_));
  open_fresh_if_damaged(utc, stop);
  store_ = std::make_unique<Store>(file_, kLive, stop);
  ours_ = storage::file_id(file_);
  if (ours_) callbacks_.on_open(*ours_);
  retention_clock_.begin(newest_to_trust(file_));
  numbers_.clear();
  for (const auto& [name, site] : sites_) numbers_[name] = store_->upsert_camera(name, site);
}

void Keeper::open(TimePoint utc) {
  try {
    open_file(utc, stop_.get_token());
  } catch (const StorageError& error) {
    store_.reset();
    failed(error);
  }
}

void Keeper::failed(const StorageError& error) {
  next_try_ = std::chrono::steady_clock::now() + kRetry;
  if (store_) store_->rollback();
  const std::string message = error.what();
  if (std::exchange(fault_, message) == message) return;
  const bool full = error.kind() == StorageError::Kind::full;
  report(EventKind::disk_full, Severity::error,
         std::string(full ? "the disk is full" : "the database cannot be written") + ": " + message +
             "; observations wait in memory");
  callbacks_.on_fault(message);
}

void Keeper::start_afresh(TimePoint utc, const std::string& why, bool set_aside_first) {
  store_.reset();
  try {
    std::string kept;
    if (set_aside_first && std::filesystem::exists(file_))
      kept = "; it is kept as " + storage::set_aside(file_, utc).filename().string();
    report(EventKind::database_set_aside, Severity::error,
           why + kept + "; the station goes on with a fresh one");
  } catch (const StorageError& error) {
    failed(error);
    return;
  }
  references_.assign(in_force_.begin(), in_force_.end());
  open(utc);
}

// The file was deleted, or another one (a backup that is put back) stands in its place. What is left of the
// old one's WAL must not be played into the new one.
void Keeper::start_with_another_file(TimePoint utc) {
  std::error_code unknown;
  if (!std::filesystem::exists(file_, unknown))
    return start_afresh(utc, "the database's file was removed", false);
  store_.reset();
  wal_is_anothers_ = true;
  report(EventKind::database_set_aside, Severity::warning,
         "the database's file was replaced; the station goes on with the one that is there now");
  references_.assign(in_force_.begin(), in_force_.end());
  open(utc);
}

void Keeper::set_aside_damaged(const storage::FileId& file, const std::string& found) {
  if (store_ && file == ours_ && file_is_ours())
    start_afresh(utc_, "the database is damaged (" + found.substr(0, 200) + ")", true);
}

bool Keeper::attempt(const std::function<void(Store&)>& work) {
  if (!store_) return false;
  try {
    work(*store_);
    return true;
  } catch (const StorageError& error) {
    if (error.kind() == StorageError::Kind::corrupt)
      start_afresh(utc_, "the database is damaged (" + std::string(error.what()) + ")", true);
    else
      failed(error);
    return false;
  }
}

void Keeper::add_camera(const std::string& name, const Site& site) {
  sites_[name] = site;
  attempt([&](Store& store) { numbers_[name] = store.upsert_camera(name, site); });
}

storage::CameraNumber Keeper::number_of(Store& store, const std::string& camera) {
  if (!numbers_.contains(camera)) numbers_[camera] = store.upsert_camera(camera, sites_[camera]);
  return numbers_[camera];
}

void Keeper::drain() {
  while (!waiting_.empty()) {
    const Waiting& next = waiting_.front();
    if (!attempt([&](Store& store) { store.put(number_of(store, next.camera), next.result); })) return;
    waiting_.pop_front();
  }
  while (!references_.empty()) {
    const auto next = references_.front();
    if (!attempt([&](Store& store) { store.put_reference(number_of(store, next.first), next.second); }))
      return;
    if (!references_.empty()) references_.pop_front();
  }
  while (!events_.empty()) {
    Event event = events_.front();
    if (!attempt([&](Store& store) { event.number = store.put_event(event); })) return;
    if (events_.empty()) return;  // start_afresh() may have changed the list
    events_.pop_front();
    callbacks_.on_event(event);
  }
  if (!fault_.empty() && store_) {
    fault_.clear();
    callbacks_.on_fault("");
    const std::string lost =
        lost_ ? "; " + std::to_string(lost_) + " observations did not fit into memory and are lost" : "";
    report(EventKind::database_recovered, lost_ ? Severity::error : Severity::info,
           "the database can be written again" + lost);
    lost_ = 0;
  }
}

void Keeper::put(const std::string& camera, FrameResult result) {
  waiting_.push_back({camera, std::move(result)});
  if (waiting_.size() > kMostWaiting) {
    waiting_.pop_front();
    ++lost_;
  }
  if (fault_.empty()) drain();
}

void Keeper::put_event(Event event) {
  add_event(std::move(event));
  if (fault_.empty()) drain();
}

void Keeper::put_reference(const std::string& camera, const storage::ReferenceRecord& reference) {
  in_force_[camera] = reference;
  references_.emplace_back(camera, reference);
  if (fault_.empty()) drain();
}

void Keeper::put_picture(const std::string& camera, const storage::PictureRecord& picture) {
  attempt([&](Store& store) { store.put_picture(number_of(store, camera), picture); });
}

void Keeper::erase_picture(const storage::PictureRecord& picture) {
  attempt([&](Store& store) { store.erase_picture(picture); });
}

void Keeper::tick(TimePoint utc, std::chrono::steady_clock::time_point now) {
  utc_ = utc;
  if (now >= next_look_) {
    next_look_ = now + kLookEvery;
    if (store_ && !file_is_ours()) start_with_another_file(utc);
  }
  if (now >= next_try_ && (!fault_.empty() || !store_)) {
    if (!store_) open(utc);
    if (store_) drain();
  }
  if (!store_ || !fault_.empty()) return;
  drain();
  if (now >= next_checkpoint_) {
    bool whole = false;
    attempt([&](Store& store) { whole = store.checkpoint(); });
    next_checkpoint_ = now + (whole ? checkpoint_every_ : std::min(kCheckpointRetry, checkpoint_every_));
  }
  if (now >= next_retention_) next_retention_ = drop_what_is_old(utc, now) ? now : now + kRetentionEvery;
}

// Whether there may be more.
bool Keeper::drop_what_is_old(TimePoint utc, std::chrono::steady_clock::time_point now) {
  const TimePoint time = retention_clock_.follow(utc, now);
  const bool lags = retention_clock_.behind() > kWorthATelling;
  if (lags && !std::exchange(told_of_lag_, true))
    report(EventKind::retention, Severity::warning,
           "the clock is " +
               std::to_string(std::chrono::floor<std::chrono::days>(retention_clock_.behind()).count()) +
               " days ahead of the newest stored frame; what is too old by it is dropped slowly, a day in an "
               "hour");
  int dropped = 0;
  attempt([&](Store& store) { dropped = storage::apply_retention(store, retention_, time); });
  return dropped > 0;
}

void Keeper::close() {
  drain();
  attempt([](Store& store) { store.checkpoint(); });
  if (!waiting_.empty())
    log(LogLevel::error, "observations are lost: the database could not be written",
        {{"count", std::to_string(waiting_.size())}});
  store_.reset();
}

}  // namespace lampglow::daemon
