// Since when each worker is at its frame, for the watchdog.
#pragma once

#include <chrono>
#include <map>
#include <mutex>
#include <string>

namespace lampglow::daemon {

class WorkWatch {
  using Time = std::chrono::steady_clock::time_point;
  using Frames = std::multimap<Time, std::string>;

 public:
  // A worker that is at one frame for longer than that counts as stuck.
  explicit WorkWatch(std::chrono::microseconds longest) : longest_(longest) {}

  // A worker's frame, for as long as it lives.
  class Running {
   public:
    Running(WorkWatch& watch, std::string camera);
    ~Running();
    Running(const Running&) = delete;
    Running& operator=(const Running&) = delete;

   private:
    WorkWatch& watch_;
    Frames::iterator mine_;
  };

  // Which worker is stuck, in words: the one that is at its frame the longest. Empty: none is.
  std::string stuck(Time now) const;

 private:
  const std::chrono::microseconds longest_;
  mutable std::mutex mutex_;
  Frames running_;  // since when, and of which camera
};

}  // namespace lampglow::daemon
