// What happens to a frame: the workers estimate it, the writer stores it, then it is shown. And what is told
// meanwhile.
#include <fmt/format.h>
#include <malloc.h>
#include <pthread.h>

#include "daemon/replay/ordered_pool.h"
#include "daemon/station/log.h"
#include "daemon/station/station_impl.h"

namespace lampglow::daemon {

using std::chrono::milliseconds;
using std::chrono::seconds;
using std::chrono::steady_clock;
using storage::Event;
using storage::EventKind;
using storage::Severity;

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

// On the writer's thread: a night has taught something.
void Station::Impl::take_over(const Taught& taught) {
  log(LogLevel::info, taught.event.message, {{"camera", taught.setup->name}});
  put_in_force(taught.setup);
  keeper.put_reference(taught.setup->name, taught.record);
  keeper.put_event(taught.event);
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

// From the backup's thread.
void Station::Impl::note_backup(Backups::Result result, const std::string& message,
                                const storage::FileId& file) {
  const bool good = result == Backups::Result::good;
  const bool damaged = result == Backups::Result::damaged;
  const std::string text = damaged ? "the backup failed: the database is damaged" : message;
  live.set_fault("backup", good ? "" : "failed; see the events");
  if (damaged) writes.push([this, message, file] { keeper.set_aside_damaged(file, message); });
  tell({0, utc_time(), good ? EventKind::backup_made : EventKind::backup_failed,
        good ? Severity::info : Severity::error, "", text});
}

}  // namespace lampglow::daemon
