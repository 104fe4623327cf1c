#include "daemon/station/station.h"

#include "daemon/errors.h"
#include "daemon/station/log.h"
#include "daemon/station/notify.h"
#include "daemon/station/remembered.h"
#include "daemon/station/station_impl.h"
#include "daemon/station/status_text.h"
#include "daemon/station/stop_while_busy.h"

namespace lampglow::daemon {
namespace {

using std::chrono::seconds;
using std::chrono::steady_clock;
using storage::Event;
using storage::EventKind;
using storage::Severity;

constexpr seconds kLongestWriterStep{60};
constexpr seconds kLongestDrain{3};  // of the 5 s that an end may take

web::LiveOptions live_options(const StationConfig& config) {
  web::LiveOptions options;
  options.stale_after = config.stale_after;
  options.frame_interval = config.cameras.front().schedule.interval;
  options.version = LAMPGLOW_VERSION;
  return options;
}

web::ApiOptions api_options(const StationConfig& config) {
  return {config.database(), config.picture_directory(), config.access};
}

// Twice the unit's WatchdogSec= (60 s); where no watchdog waits, as if it were that.
std::chrono::microseconds longest_estimate() {
  return 2 * watchdog_period().value_or(seconds(60));
}

}  // namespace

Station::Impl::Impl(const StationConfig& given, const std::stop_token& stop)
    : config(given),
      live(live_options(given)),
      jobs(worker_count(given)),
      jpeg_quality(given.pictures.jpeg_quality),
      watch(longest_estimate()),
      pictures(given.picture_directory(), given.pictures),
      keeper(given.database(), given.retention, given.checkpoint_every,
             {[this](const Event& event) { live.publish_event(event); },
              [this](const std::string& fault) {
                live.set_fault("database", fault.empty() ? "" : "cannot be written");
              },
              [this](std::chrono::seconds at_most) { allow_long_step(at_most); },
              [this](const storage::FileId& file) { use_database(file); }},
             stop),
      backups(given.database(), given.backup_directory(), given.backups_kept, given.backup_hour_utc,
              [this](Backups::Result result, const std::string& message, const storage::FileId& file) {
                note_backup(result, message, file);
              }) {
  for (const CameraConfig& camera : config.cameras) install_camera(camera, open_camera(camera, stop));
  for (const CameraConfig& camera : config.cameras) restore(camera.name);
  pictures.load(kept_pictures(config.database(), utc_time()));
  server = std::make_unique<web::Server>(config.http, live, api_options(config));
  if (database_file) server->use_database(database_file);
}

// A step of the writer that has reason to take long: the check of a large database.
void Station::Impl::allow_long_step(seconds at_most) {
  const bool over = at_most == seconds(0);
  if (!over) notify_long_step(at_most);
  if (over) writer_moved = steady_clock::now().time_since_epoch().count();
  writer_may_take_until = over ? 0 : (steady_clock::now() + at_most).time_since_epoch().count();
}

// By the constructor, then by the writer.
void Station::Impl::use_database(const storage::FileId& file) {
  database_file = file;
  if (server) server->use_database(file);
}

void Station::Impl::start() {
  server->start();
  writer_moved = steady_clock::now().time_since_epoch().count();
  writer = std::jthread([this] { write(); });
  workers = std::jthread([this] {
    work();
    worked.release();
  });
  const std::scoped_lock lock(feeds_mutex);
  for (const auto& [name, feed] : feeds) feed->start();
  live.set_not_ready("");
  log(LogLevel::info, "station started",
      {{"cameras", std::to_string(feeds.size())},
       {"http", config.http.address + ":" + std::to_string(server->port())},
       {"database", config.database().string()}});
}

// After kLongestDrain what is not measured yet is given up, and stored as that.
void Station::Impl::bound_drain() {
  if (worked.try_acquire_for(kLongestDrain)) return;
  log(LogLevel::warning, "too slow to end: frames that are not measured yet are stored without a value");
  give_up.request_stop();
}

// Sources first; what they gave is estimated and stored; the server goes last.
void Station::Impl::stop() {
  if (stopped.exchange(true)) return;
  live.set_not_ready("stopping");
  keeper.request_stop();
  backups.request_stop();  // a copy that is being made would hold up the last checkpoint
  for (const auto& [name, feed] : feeds) feed->request_stop();
  {
    std::jthread bound;
    if (workers.joinable()) bound = std::jthread([this] { bound_drain(); });
    for (const auto& [name, feed] : feeds) feed->join();  // a frame that waits for a place still gets it
    jobs.close();
    if (workers.joinable()) workers.join();
  }
  if (writer.joinable()) {
    tell({0, utc_time(), EventKind::stopped, Severity::info, "", "station stopped"});
    writes.close();
    writer.join();
  }
  if (server) server->stop();
}

Station::Station(const StationConfig& config, const std::stop_token& stop) {
  try {
    impl_ = std::make_unique<Impl>(config, stop);
  } catch (const storage::StorageError& error) {
    if (error.kind() == storage::StorageError::Kind::stopped) throw Stopped(error.what());
    throw DataError(error.what());
  } catch (const CommandError&) {
    throw;
  } catch (const Stopped&) {
    throw;
  } catch (const std::runtime_error& error) {
    throw IoError(error.what());
  }
}

Station::~Station() {
  if (impl_) impl_->stop();
}

void Station::start() {
  impl_->start();
  impl_->tell(
      {0, utc_time(), EventKind::started, Severity::info, "", "station started, version " LAMPGLOW_VERSION});
}

void Station::stop() {
  impl_->stop();
}

std::vector<std::string> Station::reload(const StationConfig& config, const std::stop_token& stop) {
  return impl_->reload(config, stop);
}

unsigned short Station::port() const {
  return impl_->server->port();
}

std::string Station::status_text() const {
  return daemon::status_text(impl_->live);
}

std::string Station::stuck() const {
  const auto now = steady_clock::now();
  const steady_clock::time_point moved{steady_clock::duration{impl_->writer_moved.load()}};
  const bool long_step = now.time_since_epoch().count() < impl_->writer_may_take_until;
  if (now - moved > kLongestWriterStep && !long_step) return "the database's writer does not move";
  if (std::string worker = impl_->watch.stuck(now); !worker.empty()) return worker;
  const std::scoped_lock lock(impl_->feeds_mutex);
  for (const auto& [name, feed] : impl_->feeds)
    if (feed->stuck(now)) return "the schedule of camera " + name + " does not move";
  return "";
}

void Station::look_after() {
  const std::scoped_lock lock(impl_->feeds_mutex);
  for (const auto& [name, feed] : impl_->feeds) {
    const web::CameraHealth health = feed->health();
    impl_->live.set_health(name, health);
    impl_->live.set_fault("camera " + name, health.up ? "" : health.fault);
  }
}

}  // namespace lampglow::daemon
