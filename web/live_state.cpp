#include "web/live_state.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include "web/last_hour.h"
#include "web/message_log.h"
#include "web/metrics_text.h"
#include "web/query.h"

namespace lampglow::web {
namespace {

using storage::ObservationRow;

struct CameraState {
  storage::CameraRecord record;
  std::vector<storage::LampRecord> lamps;
  std::optional<FrameResult> latest;
  LastHour hour;
  FeatureHalves fresh, stale;
  std::string etag;
  CameraHealth health;
  std::optional<Picture> picture;
  CameraCounters counters;
};

bool failed(const FrameResult& result) {
  return !result.observation.extinction_per_m;
}

}  // namespace

struct LiveState::Impl {
  explicit Impl(LiveOptions given)
      : options(std::move(given)), messages(options.stream_messages, options.stale_after) {
    if (!options.now)
      options.now = [] {
        return std::chrono::time_point_cast<std::chrono::milliseconds>(std::chrono::system_clock::now());
      };
  }

  CameraState* find(const std::string& name) {
    if (name.empty()) return cameras.empty() ? nullptr : cameras.front().get();
    for (const auto& camera : cameras)
      if (camera->record.name == name) return camera.get();
    return nullptr;
  }

  static ObservationRow row_of(const FrameResult& result) {
    ObservationRow row;
    row.observation = result.observation;
    row.reason = result.reason;
    row.values = failed(result) ? 0 : 1;
    return row;
  }

  void render(CameraState& camera) {
    if (!camera.latest) return;
    const ObservationRow row = row_of(*camera.latest);
    const ObservationRow minute = camera.hour.running_mean(60), ten = camera.hour.running_mean(600);
    CurrentParts parts{
        &camera.record, &row, &minute, &ten, camera.hour.trend(), camera.health, options.stale_after.count()};
    camera.fresh = current_feature(parts, false);
    camera.stale = current_feature(parts, true);
    // The sensor's state is in the answer, too.
    camera.etag = percent_encode(camera.record.name) + "/" + format_time_utc(row.observation.time_utc) +
                  (camera.health.fault.empty() ? "" : "/" + camera.health.fault);
  }

  // False if the frame is older than what is current (a late one): it does not become current.
  bool take(CameraState& camera, const FrameResult& result) {
    if (camera.latest && result.observation.time_utc < camera.latest->observation.time_utc &&
        camera.latest->observation.time_utc <= options.now())
      return false;
    camera.latest = result;
    camera.hour.add(result.observation);
    render(camera);
    return true;
  }

  double age_s(const CameraState& camera) const {
    const auto age = options.now() - camera.latest->observation.time_utc;
    return std::max(0.0, std::chrono::duration<double>(age).count());
  }

  // One from far ahead is of a time before the clock was set back, nobody knows how long ago.
  bool is_stale(const CameraState& camera) const {
    const auto age = options.now() - camera.latest->observation.time_utc;
    return std::chrono::abs(age) > options.stale_after;
  }

  LiveOptions options;
  mutable std::mutex mutex;
  std::vector<std::unique_ptr<CameraState>> cameras;
  MessageLog messages;
  std::function<void()> notify;
  std::map<std::string, std::string> faults;
  std::string not_ready = "starting";
  std::map<int, std::uint64_t> requests;
  int stream_clients = 0;
};

LiveState::LiveState(LiveOptions options) : impl_(std::make_unique<Impl>(std::move(options))) {}
LiveState::~LiveState() = default;

void LiveState::set_camera(const std::string& name, const Site& site) {
  const std::lock_guard lock(impl_->mutex);
  CameraState* camera = name.empty() ? nullptr : impl_->find(name);
  if (!camera) camera = impl_->cameras.emplace_back(std::make_unique<CameraState>()).get();
  camera->record = {0,
                    name,
                    site.name,
                    site.latitude_deg,
                    site.longitude_deg,
                    site.elevation_m,
                    site.camera.width_px,
                    site.camera.height_px};
  camera->lamps.clear();
  for (const Light& light : site.lights)
    camera->lamps.push_back({light.id, light.x_px, light.y_px, light.distance_m, {}});
  impl_->render(*camera);
}

void LiveState::publish(const std::string& name, const FrameResult& result,
                        std::optional<double> duration_s) {
  std::function<void()> notify;
  {
    const std::lock_guard lock(impl_->mutex);
    CameraState* camera = impl_->find(name);
    if (!camera) return;
    camera->counters.count(!failed(result), duration_s);
    const bool current = impl_->take(*camera, result);
    if (current) {
      impl_->messages.add_observation(result.observation.time_utc, camera->fresh,
                                      observation_feature(camera->record, Impl::row_of(result)));
      notify = impl_->notify;
    }
  }
  if (notify) notify();
}

void LiveState::restore(const std::string& name, const FrameResult& result) {
  const std::lock_guard lock(impl_->mutex);
  if (CameraState* camera = impl_->find(name)) impl_->take(*camera, result);
}

void LiveState::publish_event(const storage::Event& event) {
  std::function<void()> notify;
  {
    const std::lock_guard lock(impl_->mutex);
    impl_->messages.add_event(event.time_utc, event_json(event));
    notify = impl_->notify;
  }
  if (notify) notify();
}

void LiveState::set_health(const std::string& name, const CameraHealth& health) {
  const std::lock_guard lock(impl_->mutex);
  CameraState* camera = impl_->find(name);
  if (!camera) return;
  camera->health = health;
  impl_->render(*camera);
}

void LiveState::set_picture(const std::string& name, Picture picture) {
  const std::lock_guard lock(impl_->mutex);
  if (CameraState* camera = impl_->find(name)) camera->picture = std::move(picture);
}

void LiveState::set_not_ready(const std::string& reason) {
  const std::lock_guard lock(impl_->mutex);
  impl_->not_ready = reason;
}

void LiveState::set_fault(const std::string& part, const std::string& message) {
  const std::lock_guard lock(impl_->mutex);
  if (message.empty())
    impl_->faults.erase(part);
  else
    impl_->faults[part] = message;
}

std::vector<storage::CameraRecord> LiveState::cameras() const {
  const std::lock_guard lock(impl_->mutex);
  std::vector<storage::CameraRecord> out;
  for (const auto& camera : impl_->cameras) out.push_back(camera->record);
  return out;
}

std::optional<storage::CameraRecord> LiveState::camera(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera ? std::optional(camera->record) : std::nullopt;
}

std::optional<CurrentAnswer> LiveState::current(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  if (!camera || !camera->latest) return std::nullopt;
  const double age_s = impl_->age_s(*camera);
  const bool stale = impl_->is_stale(*camera);
  const FeatureHalves& halves = stale ? camera->stale : camera->fresh;
  CurrentAnswer answer;
  answer.body.reserve(halves.head.size() + halves.tail.size() + 16);
  answer.body = halves.head;
  answer.body += std::to_string(static_cast<std::int64_t>(age_s));
  answer.body += halves.tail;
  answer.etag = "W/\"" + camera->etag + (stale ? "/stale\"" : "\"");
  // Until the camera's own next picture, where its schedule tells; and never beyond what makes it stale.
  const auto next = camera->health.next_due_utc;
  double due_s = next ? std::chrono::duration<double>(*next - impl_->options.now()).count()
                      : static_cast<double>(impl_->options.frame_interval.count()) - age_s;
  if (!stale) due_s = std::min(due_s, static_cast<double>(impl_->options.stale_after.count()) - age_s);
  answer.max_age_s = static_cast<int>(std::clamp(std::ceil(due_s), 1.0, 3600.0));
  return answer;
}

std::optional<FrameResult> LiveState::latest_result(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera ? camera->latest : std::nullopt;
}

bool LiveState::is_fresh(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera && camera->latest && !impl_->is_stale(*camera);
}

std::vector<storage::LampRecord> LiveState::lamps(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera ? camera->lamps : std::vector<storage::LampRecord>();
}

std::optional<Picture> LiveState::picture(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera ? camera->picture : std::nullopt;
}

std::optional<CameraHealth> LiveState::health(const std::string& name) const {
  const std::lock_guard lock(impl_->mutex);
  const CameraState* camera = impl_->find(name);
  return camera ? std::optional(camera->health) : std::nullopt;
}

std::vector<std::string> LiveState::faults() const {
  const std::lock_guard lock(impl_->mutex);
  std::vector<std::string> out;
  for (const auto& [part, message] : impl_->faults)
    out.push_back(std::string(part).append(": ").append(message));
  return out;
}

std::string LiveState::not_ready() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->not_ready;
}

TimePoint LiveState::now() const {
  return impl_->options.now();
}

const std::string& LiveState::run_id() const {
  return impl_->messages.run_id();
}

std::uint64_t LiveState::last_sequence() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->messages.last_sequence();
}

std::optional<StreamText> LiveState::messages_after(std::uint64_t after) const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->messages.after(after, impl_->options.now());
}

void LiveState::on_message(std::function<void()> callback) {
  const std::lock_guard lock(impl_->mutex);
  impl_->notify = std::move(callback);
}

void LiveState::count_request(int status) {
  const std::lock_guard lock(impl_->mutex);
  ++impl_->requests[status];
}

void LiveState::set_stream_clients(int count) {
  const std::lock_guard lock(impl_->mutex);
  impl_->stream_clients = count;
}

std::string LiveState::metrics() const {
  const std::lock_guard lock(impl_->mutex);
  MetricsInput input;
  input.version = impl_->options.version;
  for (const auto& camera : impl_->cameras) {
    CameraMetrics entry{camera->record.name, camera->health.up, camera->counters, {}, {},
                        camera->health.tries};
    if (camera->latest) {
      const Observation& o = camera->latest->observation;
      entry.last_observation_utc = o.time_utc;
      if (!impl_->is_stale(*camera)) entry.fresh = o;
    }
    input.cameras.push_back(std::move(entry));
  }
  input.requests = impl_->requests;
  input.stream_clients = impl_->stream_clients;
  for (const auto& [part, message] : impl_->faults) input.faults.push_back(part);
  return prometheus_text(input);
}

}  // namespace lampglow::web
