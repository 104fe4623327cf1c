// What the station knows right now, in memory: the current observation of every camera as finished bytes, the
// messages of the event stream, the latest pictures, counters for the metrics. Written by the daemon's
// threads, read by the server's; every function may be called from any thread.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/site.h"
#include "storage/records.h"
#include "web/message_log.h"
#include "web/shapes.h"

namespace lampglow::web {

struct LiveOptions {
  // A replay of an old archive sets years here.
  std::chrono::seconds stale_after{300};    // older than this, the current observation has no values
  std::chrono::seconds frame_interval{60};  // for Cache-Control: when the next observation is due
  std::string version;                      // of the program, for lampglow_build_info
  int stream_messages = 1024;               // kept for Last-Event-ID
  std::function<TimePoint()> now;           // empty: the system's clock
};

struct Picture {
  TimePoint time_utc{};
  std::shared_ptr<const std::string> plain_jpeg;
  std::shared_ptr<const std::string> annotated_jpeg;
};

// /v1/current as bytes: head + age + tail.
struct CurrentAnswer {
  std::string body;
  std::string etag;
  int max_age_s = 0;
};

class LiveState {
 public:
  explicit LiveState(LiveOptions options = {});
  ~LiveState();
  LiveState(const LiveState&) = delete;
  LiveState& operator=(const LiveState&) = delete;

  // Makes the camera known (its first appearance decides the order; the first one is the default), or changes
  // its site.
  void set_camera(const std::string& name, const Site& site);
  // A camera's newest frame: becomes current unless an earlier time than what is there, goes to the stream
  // and into the counters. `duration_s`: how long the estimate took.
  void publish(const std::string& camera, const FrameResult& result, std::optional<double> duration_s = {});
  // At start, from the database: sets the current observation without a stream message or count.
  void restore(const std::string& camera, const FrameResult& result);
  void publish_event(const storage::Event& event);
  void set_health(const std::string& camera, const CameraHealth& health);
  void set_picture(const std::string& camera, Picture picture);
  // Why the station is not ready (readyz, 503); empty: ready.
  void set_not_ready(const std::string& reason);
  // A failed part of the station that goes on nevertheless (metrics, healthz); empty message: mended.
  void set_fault(const std::string& part, const std::string& message);

  std::vector<storage::CameraRecord> cameras() const;
  // The default camera for an empty name; empty if there is none of that name.
  std::optional<storage::CameraRecord> camera(const std::string& name) const;
  // Empty if the camera is unknown or nothing was published yet.
  std::optional<CurrentAnswer> current(const std::string& camera) const;
  std::optional<FrameResult> latest_result(const std::string& camera) const;
  // Whether that says what the air is like now; false if there is none.
  bool is_fresh(const std::string& camera) const;
  std::vector<storage::LampRecord> lamps(const std::string& camera) const;  // the site's catalogue
  std::optional<Picture> picture(const std::string& camera) const;
  std::optional<CameraHealth> health(const std::string& camera) const;
  std::vector<std::string> faults() const;  // "part: message"
  std::string not_ready() const;
  std::string metrics() const;
  TimePoint now() const;

  // The stream: a run's id goes into every message's id, so that a client of an earlier run is seen as such.
  const std::string& run_id() const;
  std::uint64_t last_sequence() const;
  // Messages with sequence > after; empty optional if some of them are no longer kept.
  std::optional<StreamText> messages_after(std::uint64_t after) const;
  // Called after every new message, on the publisher's thread; must be quick and must not call back.
  void on_message(std::function<void()> callback);

  // Counters of the server's own.
  void count_request(int status);
  void set_stream_clients(int count);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::web
