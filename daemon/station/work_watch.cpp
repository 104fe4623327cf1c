#include "daemon/station/work_watch.h"

#include <utility>

namespace lampglow::daemon {

WorkWatch::Running::Running(WorkWatch& watch, std::string camera) : watch_(watch) {
  const std::scoped_lock lock(watch_.mutex_);
  mine_ = watch_.running_.emplace(std::chrono::steady_clock::now(), std::move(camera));
}

WorkWatch::Running::~Running() {
  const std::scoped_lock lock(watch_.mutex_);
  watch_.running_.erase(mine_);
}

std::string WorkWatch::stuck(Time now) const {
  const std::scoped_lock lock(mutex_);
  if (running_.empty() || now - running_.begin()->first <= longest_) return "";
  return "a worker does not come to an end with a frame of camera " + running_.begin()->second;
}

}  // namespace lampglow::daemon
