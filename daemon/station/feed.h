// Where a camera's brackets come from, for the station: a live camera on its schedule, or an archive.
#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "daemon/schedule/camera_loop.h"
#include "daemon/station/config.h"
#include "web/shapes.h"

namespace lampglow::daemon {

struct FeedCallbacks {
  std::function<void(Bracket)> on_bracket;  // may block; on the feed's thread
  std::function<void(CameraEvent)> on_event;
};

class Feed {
 public:
  virtual ~Feed() = default;
  virtual void start() = 0;
  virtual void request_stop() = 0;  // returns at once
  virtual void join() = 0;
  virtual web::CameraHealth health() const = 0;
  virtual void note_mor(std::optional<double> mor_m) = 0;
  // Has its thread broken its promise to move on by now? For the watchdog; a dead camera is no stuck thread.
  virtual bool stuck(MonotonicTime now) const = 0;
};

// An archive is played as fast as it can be estimated and then ends; anything else runs on its schedule.
// Throws ConfigError, DataError, IoError as opening the source does.
std::unique_ptr<Feed> make_feed(const CameraConfig& config, Clock& clock, FeedCallbacks callbacks);

}  // namespace lampglow::daemon
