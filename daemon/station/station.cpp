#include "daemon/station/station.h"

#include <fmt/format.h>
#include <malloc.h>
#include <pthread.h>

#include <atomic>
#include <map>
#include <mutex>
#include <semaphore>
#include <set>
#include <thread>

#include "daemon/errors.h"
#include "daemon/replay/ordered_pool.h"
#include "daemon/station/backups.h"
#include "daemon/station/bounded_queue.h"
#include "daemon/station/estimating.h"
#include "daemon/station/feed.h"
#include "daemon/station/keeper.h"
#include "daemon/station/log.h"
#include "daemon/station/notify.h"
#include "daemon/station/picture_keeper.h"
#include "daemon/station/remembered.h"
#include "daemon/station/status_text.h"
#include "daemon/station/stop_while_busy.h"
#include "daemon/station/teacher.h"
#include "daemon/station/work_watch.h"
#include "web/live_state.h"
#include "web/server.h"

namespace lampglow::daemon {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;
using storage::Event;
using storage::EventKind;
using storage::Severity;

constexpr seconds kLongestWriterStep{60};
constexpr seconds kLongestDrain{3};  // of the 5 s that an end may take

TimePoint utc_time() {
  return std::chrono::floor<milliseconds>(std::chrono::system_clock::now());
}

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

std::size_t worker_count(const StationConfig& config) {
  return config.workers ? config.workers : std::max(1U, std::thread::hardware_concurrency());
}

// A camera that could take pictures, but is not in the station yet.
struct Opened {
  std::shared_ptr<const CameraSetup> setup;
  std::unique_ptr<Feed> feed;
};

}  // namespace

struct Station::Impl {
  Impl(const StationConfig& given, const std::stop_token& stop);

  void start();
  void stop();
  void work();
  void bound_drain();
  void write();
  void take(Done done);
  bool note_fog(const Done& done);  // whether fog began
  void tell(Event event);           // from any thread: stored, logged, streamed
  Opened open_camera(const CameraConfig& camera, const std::stop_token& stop);
  void install_camera(const CameraConfig& camera, Opened opened);
  void put_in_force(const std::shared_ptr<const CameraSetup>& setup);
  void adopt(const std::shared_ptr<const CameraSetup>& fresh);
  void let_teach(const Adopted& adopted);
  void adopt_late();
  void allow_long_step(seconds at_most);
  void note_backup(Backups::Result result, const std::string& message);
  void take_over(const Taught& taught);
  void close_camera(const std::string& name);
  void restore(const std::string& camera);
  void on_camera_event(const CameraEvent& event);
  void take_over_http(const StationConfig& wanted);
  std::vector<std::string> reload(const StationConfig& wanted, const std::stop_token& stop);

  // Once it runs, the keeper belongs to the writer's thread.
  void by_writer(std::function<void()> work) {
    if (writer.joinable())
      writes.push(std::move(work));
    else
      work();
  }

  // What a camera's feed pushes into; the pool takes from it.
  std::shared_ptr<const CameraSetup> setup_of(const std::string& camera) {
    const std::scoped_lock lock(setups_mutex);
    const auto found = setups.find(camera);
    return found == setups.end() ? nullptr : found->second;
  }

  StationConfig config;
  SystemClock clock;
  web::LiveState live;
  BoundedQueue<Job> jobs;
  BoundedQueue<std::function<void()>> writes{64};
  std::atomic<int> jpeg_quality;
  WorkWatch watch{longest_estimate()};
  std::mutex setups_mutex;
  std::map<std::string, std::shared_ptr<const CameraSetup>> setups;
  std::map<std::string, std::unique_ptr<Feed>> feeds;  // the main thread's
  std::mutex feeds_mutex;                              // against note_mor from the writer
  std::atomic<steady_clock::rep> writer_may_take_until{0};
  // The writer thread's, once it runs:
  std::map<std::string, FogWatch> fog;
  Teacher teacher;
  PictureKeeper pictures;
  Keeper keeper;
  Backups backups;
  std::set<std::string> to_adopt;  // cameras whose stored reference could not be read yet
  steady_clock::time_point next_adoption{};
  std::atomic<steady_clock::rep> writer_moved{0};
  std::atomic<bool> stopped{false};
  std::stop_source give_up;  // frames that are not measured yet are not going to be
  std::unique_ptr<web::Server> server;
  std::binary_semaphore worked{0};  // the workers have come to their end
  std::jthread workers;
  std::jthread writer;
};

Station::Impl::Impl(const StationConfig& given, const std::stop_token& stop)
    : config(given),
      live(live_options(given)),
      jobs(worker_count(given)),
      jpeg_quality(given.pictures.jpeg_quality),
      pictures(given.picture_directory(), given.pictures),
      keeper(given.database(), given.retention, given.checkpoint_every,
             {[this](const Event& event) { live.publish_event(event); },
              [this](const std::string& fault) {
                live.set_fault("database", fault.empty() ? "" : "cannot be written");
              },
              [this](std::chrono::seconds at_most) { allow_long_step(at_most); }},
             stop),
      backups(given.database(), given.backup_directory(), given.backups_kept, given.backup_hour_utc,
              [this](Backups::Result result, const std::string& message) { note_backup(result, message); }) {
  for (const CameraConfig& camera : config.cameras) install_camera(camera, open_camera(camera, stop));
  for (const CameraConfig& camera : config.cameras) restore(camera.name);
  pictures.load(kept_pictures(config.database(), utc_time()));
  server = std::make_unique<web::Server>(config.http, live, api_options(config));
}

// A step of the writer that has reason to take long: the check of a large database.
void Station::Impl::allow_long_step(seconds at_most) {
  const bool over = at_most == seconds(0);
  if (!over) notify_long_step(at_most);
  writer_may_take_until = over ? 0 : (steady_clock::now() + at_most).time_since_epoch().count();
}

// From the backup's thread.
void Station::Impl::note_backup(Backups::Result result, const std::string& message) {
  const bool good = result == Backups::Result::good;
  const bool damaged = result == Backups::Result::damaged;
  const std::string text = damaged ? "the backup failed: the database is damaged" : message;
  live.set_fault("backup", good ? "" : "failed; see the events");
  if (damaged) writes.push([this, message] { keeper.set_aside_damaged(message); });
  tell({0, utc_time(), good ? EventKind::backup_made : EventKind::backup_failed,
        good ? Severity::info : Severity::error, "", text});
}

// All that can go wrong with a camera's configuration does so here, where nothing has changed yet.
Opened Station::Impl::open_camera(const CameraConfig& camera, const std::stop_token& stop) {
  return {set_up(camera, stop), make_feed(camera, clock,
                                          {[this, name = camera.name](Bracket bracket) {
                                             if (auto known = setup_of(name))
                                               jobs.push({std::move(known), std::move(bracket)});
                                           },
                                           [this](const CameraEvent& event) { on_camera_event(event); }})};
}

void Station::Impl::install_camera(const CameraConfig& camera, Opened opened) {
  live.set_camera(camera.name, camera.site);
  by_writer([this, name = camera.name, site = camera.site] { keeper.add_camera(name, site); });
  adopt(opened.setup);
  const std::scoped_lock lock(feeds_mutex);
  feeds[camera.name] = std::move(opened.feed);
}

void Station::Impl::put_in_force(const std::shared_ptr<const CameraSetup>& setup) {
  const std::scoped_lock lock(setups_mutex);
  setups[setup->name] = setup;
}

// The clear brackets' reference, with what service taught since by the database.
void Station::Impl::adopt(const std::shared_ptr<const CameraSetup>& fresh) {
  const Adopted adopted = adopt_reference(config.database(), fresh, utc_time());
  put_in_force(adopted.setup);
  by_writer([this, adopted] { let_teach(adopted); });
}

// On the writer's thread. Where the database could not be read, what nights have taught is not known: nothing
// must be taught on top of the brackets and stored as the newest.
void Station::Impl::let_teach(const Adopted& adopted) {
  if (!adopted.known) {
    to_adopt.insert(adopted.setup->name);
    teacher.forget(adopted.setup->name);
    return;
  }
  if (adopted.to_store) keeper.put_reference(adopted.setup->name, *adopted.to_store);
  teacher.take_over(adopted);
}

// On the writer's thread, once the database can be read after all.
void Station::Impl::adopt_late() {
  const auto now = steady_clock::now();
  if (to_adopt.empty() || !keeper.is_open() || now < next_adoption) return;
  next_adoption = now + seconds(60);
  for (const std::string& camera : std::exchange(to_adopt, {})) {
    const auto setup = setup_of(camera);
    if (!setup) continue;
    const Adopted adopted = adopt_reference(config.database(), setup, utc_time());
    put_in_force(adopted.setup);
    let_teach(adopted);
  }
}

// On the writer's thread: a night has taught something.
void Station::Impl::take_over(const Taught& taught) {
  log(LogLevel::info, taught.event.message, {{"camera", taught.setup->name}});
  put_in_force(taught.setup);
  keeper.put_reference(taught.setup->name, taught.record);
  keeper.put_event(taught.event);
}

// So that a restart does not forget what the air is like.
void Station::Impl::restore(const std::string& name) {
  for (const FrameResult& result : last_hour(config.database(), name)) {
    live.restore(name, result);
    fog[name].note(result.observation);  // so that the same fog has no second onset
  }
}

void Station::Impl::tell(Event event) {
  log(event.severity == Severity::error     ? LogLevel::error
      : event.severity == Severity::warning ? LogLevel::warning
                                            : LogLevel::info,
      event.message, {{"event", std::string(to_string(event.kind))}, {"camera", event.camera}});
  writes.push([this, event = std::move(event)] { keeper.put_event(event); });
}

void Station::Impl::on_camera_event(const CameraEvent& event) {
  const bool recovered = event.fault == Fault::none;
  const EventKind kind = recovered                             ? EventKind::source_recovered
                         : event.fault == Fault::clock_stepped ? EventKind::clock_stepped
                                                               : EventKind::source_failed;
  std::string message = recovered ? "recovered" : std::string(to_string(event.fault));
  if (!event.message.empty()) message += ": " + event.message;
  tell({0, event.time_utc, kind, recovered ? Severity::info : Severity::warning, event.camera, message});
}

void Station::Impl::work() {
  OrderedPool<Job, Done> pool(
      [this](const std::stop_token&) -> std::optional<Job> {
        while (!jobs.drained())
          if (auto job = jobs.pop({}, seconds(1))) return job;
        return std::nullopt;
      },
      [this](Job&& job) {
        const WorkWatch::Running running(watch, job.setup->name);
        return estimate_job(job, jpeg_quality, give_up.get_token());
      },
      [this](Done&& done) {
        auto shared = std::make_shared<Done>(std::move(done));
        writes.push([this, shared] { take(std::move(*shared)); });
      },
      {worker_count(config), worker_count(config)});
  pool.run({});
}

bool Station::Impl::note_fog(const Done& done) {
  const Observation& observation = done.result.observation;
  const FogWatch::Change change = fog[done.setup->name].note(observation);
  if (change == FogWatch::Change::none) return false;
  const bool began = change == FogWatch::Change::began;
  const std::string message =
      fmt::format("fog {}: visibility {:.0f} m", began ? "began" : "ended", observation.mor_m().value_or(0));
  log(LogLevel::info, message, {{"camera", done.setup->name}});
  keeper.put_event({0, observation.time_utc, began ? EventKind::fog_began : EventKind::fog_ended,
                    Severity::info, done.setup->name, message});
  return began;
}

// On the writer's thread: stored first, then shown.
void Station::Impl::take(Done done) {
  const std::string& name = done.setup->name;
  const Observation& observation = done.result.observation;
  keeper.put(name, done.result);
  if (const auto taught = teacher.add(done)) take_over(*taught);
  const bool fog_began = note_fog(done);
  if (done.pictures.plain_jpeg) {
    pictures.offer(name, observation.time_utc, fog_began, *done.pictures.plain_jpeg, keeper);
    live.set_picture(name, {observation.time_utc, done.pictures.plain_jpeg, done.pictures.annotated_jpeg});
  }
  live.publish(name, done.result, done.duration_s);
  const std::scoped_lock lock(feeds_mutex);
  if (const auto feed = feeds.find(name); feed != feeds.end()) feed->second->note_mor(observation.mor_m());
}

void Station::Impl::write() {
  pthread_setname_np(pthread_self(), "writer");  // for `top -H`
  while (!writes.drained()) {
    writer_moved = steady_clock::now().time_since_epoch().count();
    if (auto write = writes.pop({}, milliseconds(500))) {
      (*write)();
      write.reset();
      malloc_trim(0);  // what the frame needed and freed goes back to the system: some ms a frame
    }
    keeper.tick(utc_time(), steady_clock::now());
    adopt_late();
    for (const Taught& taught : teacher.tick(utc_time())) take_over(taught);
    backups.tick(utc_time());
  }
  backups.stop();
  keeper.close();
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

void Station::Impl::close_camera(const std::string& name) {
  std::unique_ptr<Feed> feed;
  {
    const std::scoped_lock lock(feeds_mutex);
    feed = std::move(feeds[name]);
    feeds.erase(name);
  }
  if (!feed) return;
  feed->request_stop();
  feed->join();
  live.set_fault("camera " + name, "");
}

// A renewed certificate is in the same files, so they are read anew whatever their names. Throws where they
// are of no use, and has then changed nothing.
void Station::Impl::take_over_http(const StationConfig& wanted) {
  if (!config.http.tls.certificate.empty() && !wanted.http.tls.certificate.empty()) {
    server->set_tls(wanted.http.tls);
    config.http.tls = wanted.http.tls;
  }
  if (config.access == wanted.access) return;
  server->set_access(wanted.access);
  config.access = wanted.access;
}

std::vector<std::string> Station::Impl::reload(const StationConfig& wanted, const std::stop_token& stop) {
  std::vector<std::string> left = needs_restart(config, wanted);
  std::map<std::string, std::string> before;
  for (const CameraConfig& camera : config.cameras) before[camera.name] = camera.fingerprint;
  std::map<std::string, Opened> changed;
  for (const CameraConfig& camera : wanted.cameras)
    if (!before.contains(camera.name) || before[camera.name] != camera.fingerprint)
      changed[camera.name] = open_camera(camera, stop);
  take_over_http(wanted);
  std::set<std::string> wanted_names;
  for (const CameraConfig& camera : wanted.cameras) {
    wanted_names.insert(camera.name);
    if (!changed.contains(camera.name)) {
      if (const auto setup = setup_of(camera.name)) adopt(setup);  // `lampglow reference restore`
      continue;
    }
    close_camera(camera.name);
    install_camera(camera, std::move(changed[camera.name]));
    const std::scoped_lock lock(feeds_mutex);
    feeds[camera.name]->start();
  }
  for (const auto& [name, fingerprint] : before)
    if (!wanted_names.contains(name)) {
      close_camera(name);
      live.set_health(name, {false, "stopped", "no longer in the configuration", {}, {}});
      writes.push([this, gone = name] { teacher.forget(gone); });
      left.push_back("camera " + name + " is stopped, but stays in answers until a restart");
    }
  writes.push([this, wanted] {
    keeper.set_retention(wanted.retention);
    keeper.set_checkpoint_every(wanted.checkpoint_every);
    pictures.set_options(wanted.pictures);
    backups.set(wanted.backups_kept, wanted.backup_hour_utc);
  });
  jpeg_quality = wanted.pictures.jpeg_quality;
  config.cameras = wanted.cameras;
  tell({0, utc_time(), EventKind::configuration_changed, Severity::info, "", "configuration reloaded"});
  return left;
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
