// One camera's thread: waits for the schedule, takes a bracket, checks it, and tells what came of it. A
// camera that fails is tried again on the reconnect ladder and delays nobody but itself.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/schedule/adapt.h"
#include "daemon/schedule/clock.h"
#include "daemon/schedule/schedule.h"
#include "daemon/sources/checks.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/frame_source.h"
#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

struct CameraLoopOptions {
  std::string id;  // the camera's name in the configuration
  ScheduleOptions schedule;
  std::optional<Place> place{};                     // of the site; empty: night and day can't be told apart
  FrameCheckOptions checks;                         // size, depth, frozen after so many
  std::optional<AdaptOptions> adapt{};              // the bracket's adaptation; empty: fixed settings
  std::chrono::milliseconds clock_step{2'000};      // UTC moved this much against monotonic: a clock step
  std::chrono::milliseconds attempt_limit{90'000};  // no try of the source lasts longer: for the watchdog
  std::uint64_t seed = 1;                           // of the ladder's jitter
};

// What came of one scheduled slot. Every slot gets exactly one.
struct SlotReport {
  std::string camera;
  TimePoint slot_utc{};
  // Always there, so that every slot has a record: with exposures if all is well; else without, its `quality`
  // and `fault` say why. Its time_utc is the picture's, or the slot's where there is no picture.
  Bracket bracket;
  Fault fault = Fault::none;             // why there is no usable picture
  int attempts = 0;                      // tries in this slot
  std::chrono::milliseconds latency{0};  // of the last try
};

// A change in a camera's health: a fault began or changed its reason, the camera recovered, the clock
// stepped.
struct CameraEvent {
  std::string camera;
  TimePoint time_utc{};
  Fault fault = Fault::none;            // none: recovered
  std::string message;                  // no secrets in it
  std::chrono::milliseconds lasted{0};  // recovered: how long the fault had lasted
};

struct CameraStatus {
  std::string camera;
  std::string source;         // redacted
  bool up = false;            // the last try gave a good picture
  Fault fault = Fault::none;  // of the last try
  std::string message;
  std::optional<TimePoint> last_frame_utc{};
  std::optional<TimePoint> next_due_utc{};  // the next slot; empty: none wanted for two days
  std::optional<bool> locked{};
  std::map<Fault, std::uint64_t> tries;  // by outcome, Fault::none for good ones
  std::uint64_t slots = 0;               // reported so far
  std::chrono::milliseconds last_latency{0};
  MonotonicTime last_progress{};  // the thread last moved on: for the watchdog
  MonotonicTime busy_until{};     // it promises to move on again before this
};

struct CameraCallbacks {
  // Called on the camera's thread. Must not throw; if it blocks, only this camera waits.
  std::function<void(SlotReport)> on_slot;
  std::function<void(CameraEvent)> on_event;
};

class CameraLoop {
 public:
  // Does not start yet. The clock must outlive the loop.
  CameraLoop(CameraLoopOptions options, std::unique_ptr<FrameSource> source, Clock& clock,
             CameraCallbacks callbacks);
  CameraLoop(const CameraLoop&) = delete;
  CameraLoop& operator=(const CameraLoop&) = delete;
  ~CameraLoop();  // stops and joins

  void start();
  void request_stop();  // returns at once; a running network transfer is broken off
  void join();

  CameraStatus status() const;  // from any thread

  // The air as last estimated, for the interval in fog and in clear air; empty: not known. From any thread.
  void note_mor(std::optional<double> mor_m);

 private:
  class Worker;
  std::unique_ptr<Worker> worker_;
};

}  // namespace lampglow::daemon
