#include "daemon/schedule/camera_loop.h"

#include <fmt/format.h>
#include <pthread.h>

#include <cmath>
#include <condition_variable>
#include <mutex>
#include <thread>

#include "daemon/schedule/ladder.h"

namespace lampglow::daemon {

using std::chrono::milliseconds;

namespace {

milliseconds since(MonotonicTime earlier, MonotonicTime later) {
  return std::chrono::duration_cast<milliseconds>(later - earlier);
}

// What one try of the source gave.
struct Outcome {
  Fault fault = Fault::none;
  std::string message;
  std::optional<Bracket> bracket;  // empty with Fault::none: the source has no more
};

}  // namespace

class CameraLoop::Worker {
 public:
  Worker(CameraLoopOptions options, std::unique_ptr<FrameSource> source, Clock& clock,
         CameraCallbacks callbacks)
      : options_(std::move(options)),
        source_(std::move(source)),
        clock_(clock),
        callbacks_(std::move(callbacks)),
        checker_(options_.checks),
        ladder_(options_.seed) {
    status_.camera = options_.id;
    status_.source = source_->name();
    status_.last_progress = status_.busy_until = clock_.monotonic();
  }

  void start() {
    thread_ = std::jthread([this](std::stop_token stop) { run(stop); });
  }
  void request_stop() { thread_.request_stop(); }
  void join() {
    if (thread_.joinable()) thread_.join();
  }
  CameraStatus status() const {
    const std::scoped_lock lock(mutex_);
    return status_;
  }
  void note_mor(std::optional<double> mor_m) {
    const std::scoped_lock lock(mutex_);
    mor_m_ = mor_m;
  }

 private:
  enum class Waited { reached, clock_stepped, stopped };

  void run(std::stop_token stop);
  Waited wait_for(std::optional<TimePoint> due, std::stop_token stop);
  void run_slot(TimePoint slot, MonotonicTime window_end, std::stop_token stop);
  void report_missed(TimePoint last_slot);
  Outcome attempt(std::stop_token stop);
  Outcome checked(std::optional<Bracket> bracket);
  void note_outcome(const Outcome& outcome, milliseconds latency);
  void note_fault(const Outcome& outcome);
  void note_recovery();
  void note_lock(const Bracket& bracket);
  void adapt(const Bracket& bracket);
  void report(TimePoint slot, Bracket bracket, Fault fault, int attempts);
  void report_fault(TimePoint slot, Fault fault, const std::string& message, int attempts);
  void event(Fault fault, const std::string& message, milliseconds lasted = milliseconds(0));
  bool clock_stepped();
  bool wait_until(MonotonicTime time, std::stop_token stop);
  std::optional<TimePoint> due_after(TimePoint time) const;
  MonotonicTime monotonic_of(TimePoint time) const { return clock_.monotonic() + (time - clock_.utc()); }

  const CameraLoopOptions options_;
  const std::unique_ptr<FrameSource> source_;
  Clock& clock_;
  const CameraCallbacks callbacks_;
  FrameChecker checker_;
  ReconnectLadder ladder_;
  std::vector<ExposureSetting> exposures_;  // as adapted; empty until the first adaptation
  MonotonicTime not_before_{};              // the ladder's next try
  Outcome last_;                            // of the last try; its bracket is not kept
  std::optional<MonotonicTime> fault_since_;
  bool was_locked_ = true;
  bool ended_ = false;  // the source has no more
  TimePoint reference_utc_{};
  MonotonicTime reference_monotonic_{};

  mutable std::mutex mutex_;  // guards what follows
  CameraStatus status_;
  std::optional<double> mor_m_;

  std::jthread thread_;  // last: it must end before the rest does
};

std::optional<TimePoint> CameraLoop::Worker::due_after(TimePoint time) const {
  std::optional<double> mor_m;
  {
    const std::scoped_lock lock(mutex_);
    mor_m = mor_m_;
  }
  return next_due(options_.schedule, time, mor_m, options_.place);
}

void CameraLoop::Worker::run(std::stop_token stop) {
  pthread_setname_np(pthread_self(), ("cam " + options_.id).substr(0, 15).c_str());  // for `top -H`
  reference_utc_ = clock_.utc();
  reference_monotonic_ = clock_.monotonic();
  TimePoint from = reference_utc_;
  while (!stop.stop_requested() && !ended_) {
    const std::optional<TimePoint> due = due_after(from);
    {
      const std::scoped_lock lock(mutex_);
      status_.next_due_utc = due;
    }
    const Waited waited = wait_for(due, stop);
    if (waited == Waited::stopped) break;
    if (waited == Waited::clock_stepped || !due) {
      from = clock_.utc();
      continue;
    }
    const std::optional<TimePoint> after = due_after(*due);
    run_slot(*due, after ? monotonic_of(*after) : MonotonicTime::max(), stop);
    if (!clock_stepped() && !stop.stop_requested()) report_missed(*due);
    from = std::max(clock_.utc(), TimePoint{});
    if (from < *due && *due - from < options_.clock_step) from = *due;  // woken a little early
  }
  source_->close();
}

// In pieces: a computer without a clock of its own gets the time minutes after its start, and a slot that was
// hours away by the wrong one may be now.
CameraLoop::Worker::Waited CameraLoop::Worker::wait_for(std::optional<TimePoint> due, std::stop_token stop) {
  constexpr std::chrono::seconds kPiece{10};
  const MonotonicTime look_again = clock_.monotonic() + std::chrono::hours(1);  // none is due for two days
  for (;;) {
    const MonotonicTime end = due ? monotonic_of(*due) : look_again;
    if (!wait_until(std::min(end, clock_.monotonic() + kPiece), stop)) return Waited::stopped;
    if (clock_stepped()) return Waited::clock_stepped;
    if (clock_.monotonic() >= end) return Waited::reached;
  }
}

void CameraLoop::Worker::run_slot(TimePoint slot, MonotonicTime window_end, std::stop_token stop) {
  for (int attempts = 0;;) {
    if (not_before_ >= window_end || clock_.monotonic() >= window_end) {
      report_fault(slot, last_.fault == Fault::none ? Fault::slot_missed : last_.fault, last_.message,
                   attempts);
      return;
    }
    if (!wait_until(not_before_, stop)) {
      report_fault(slot, Fault::stopped, "told to stop", attempts);
      return;
    }
    const MonotonicTime began = clock_.monotonic();
    Outcome outcome = attempt(stop);
    ++attempts;
    note_outcome(outcome, since(began, clock_.monotonic()));
    if (outcome.fault == Fault::none) {
      ended_ = !outcome.bracket;
      if (!ended_) report(slot, std::move(*outcome.bracket), Fault::none, attempts);
      return;
    }
    if (outcome.fault == Fault::stopped) {
      report_fault(slot, Fault::stopped, outcome.message, attempts);
      return;
    }
    source_->close();
    not_before_ = clock_.monotonic() + ladder_.next_delay();
  }
}

// Slots that passed while the last one was still at work.
void CameraLoop::Worker::report_missed(TimePoint last_slot) {
  if (ended_) return;
  const TimePoint now = clock_.utc();
  for (auto due = due_after(last_slot); due && *due < now; due = due_after(*due)) {
    const bool faulty = last_.fault != Fault::none;
    report_fault(*due, faulty ? last_.fault : Fault::slot_missed,
                 faulty ? last_.message : "the picture before it took too long", 0);
  }
}

Outcome CameraLoop::Worker::attempt(std::stop_token stop) {
  {
    const std::scoped_lock lock(mutex_);
    status_.last_progress = clock_.monotonic();
    status_.busy_until = status_.last_progress + options_.attempt_limit;
  }
  try {
    std::optional<Bracket> bracket = source_->next(stop);
    if (!bracket && stop.stop_requested()) return {Fault::stopped, "told to stop", {}};
    return checked(std::move(bracket));
  } catch (const SourceError& error) {
    return {error.fault(), error.what(), {}};
  } catch (const std::exception& error) {
    return {Fault::internal, error.what(), {}};
  }
}

Outcome CameraLoop::Worker::checked(std::optional<Bracket> bracket) {
  if (!bracket) return {};
  if (!clock_.synchronised()) bracket->quality.set(Quality::clock_unsynchronised);
  if (bracket->exposures.empty()) return {Fault::none, "", std::move(bracket)};  // an archive's failed frame
  const CheckResult check = checker_.check(*bracket);
  if (check.fault != Fault::none) return {check.fault, source_->name() + ": " + check.message, {}};
  note_lock(*bracket);
  adapt(*bracket);
  return {Fault::none, "", std::move(bracket)};
}

void CameraLoop::Worker::note_outcome(const Outcome& outcome, milliseconds latency) {
  {
    const std::scoped_lock lock(mutex_);
    status_.last_progress = clock_.monotonic();
    status_.last_latency = latency;
    ++status_.tries[outcome.fault];
    status_.up = outcome.fault == Fault::none;
    status_.fault = outcome.fault;
    status_.message = outcome.message;
    if (outcome.bracket) status_.last_frame_utc = outcome.bracket->time_utc;
  }
  if (outcome.fault == Fault::stopped) return;
  if (outcome.fault == Fault::none) {
    note_recovery();
  } else {
    note_fault(outcome);
  }
  last_ = {outcome.fault, outcome.message, {}};
}

void CameraLoop::Worker::note_fault(const Outcome& outcome) {
  if (!fault_since_) fault_since_ = clock_.monotonic();
  if (outcome.fault != last_.fault) event(outcome.fault, outcome.message);
}

void CameraLoop::Worker::note_recovery() {
  ladder_.reset();
  not_before_ = MonotonicTime{};
  if (!fault_since_) return;
  event(Fault::none, fmt::format("recovered from {}", to_string(last_.fault)),
        since(*fault_since_, clock_.monotonic()));
  fault_since_.reset();
}

void CameraLoop::Worker::note_lock(const Bracket& bracket) {
  const bool locked = !bracket.quality.has(Quality::camera_not_locked);
  if (was_locked_ && !locked) event(Fault::not_locked, source_->name() + ": " + bracket.fault);
  was_locked_ = locked;
  const std::scoped_lock lock(mutex_);
  status_.locked = locked;
}

void CameraLoop::Worker::adapt(const Bracket& bracket) {
  if (!options_.adapt) return;
  std::vector<ExposureSetting> taken;
  for (const Exposure& exposure : bracket.exposures) {
    if (!exposure.exposure_s) return;
    taken.push_back({*exposure.exposure_s, exposure.gain_db});
  }
  const std::vector<ExposureSetting>& current = exposures_.empty() ? taken : exposures_;
  std::vector<ExposureSetting> next = adapt_bracket(current, bracket, *options_.adapt);
  if (next == current) return;
  source_->set_bracket(next);
  exposures_ = std::move(next);
}

void CameraLoop::Worker::report(TimePoint slot, Bracket bracket, Fault fault, int attempts) {
  milliseconds latency{};
  {
    const std::scoped_lock lock(mutex_);
    ++status_.slots;
    latency = status_.last_latency;
  }
  if (callbacks_.on_slot) {
    callbacks_.on_slot({options_.id, slot, std::move(bracket), fault, attempts, latency});
  }
}

void CameraLoop::Worker::report_fault(TimePoint slot, Fault fault, const std::string& message, int attempts) {
  Bracket bracket;
  bracket.time_utc = slot;
  if (const auto flag = fault_info(fault).quality) bracket.quality.set(*flag);
  if (!clock_.synchronised()) bracket.quality.set(Quality::clock_unsynchronised);
  bracket.fault = fmt::format("{}: {}", to_string(fault), message);
  report(slot, std::move(bracket), fault, attempts);
}

void CameraLoop::Worker::event(Fault fault, const std::string& message, milliseconds lasted) {
  if (callbacks_.on_event) callbacks_.on_event({options_.id, clock_.utc(), fault, message, lasted});
}

bool CameraLoop::Worker::clock_stepped() {
  const TimePoint utc = clock_.utc();
  const MonotonicTime monotonic = clock_.monotonic();
  const milliseconds moved = (utc - reference_utc_) - since(reference_monotonic_, monotonic);
  reference_utc_ = utc;
  reference_monotonic_ = monotonic;
  if (std::chrono::abs(moved) <= options_.clock_step) return false;
  event(Fault::clock_stepped, fmt::format("the system's clock moved by {:+.1f} s", moved.count() / 1e3));
  return true;
}

bool CameraLoop::Worker::wait_until(MonotonicTime time, std::stop_token stop) {
  {
    const std::scoped_lock lock(mutex_);
    status_.last_progress = clock_.monotonic();
    status_.busy_until = std::max(status_.last_progress, time) + std::chrono::seconds(5);
  }
  return clock_.wait_until(time, stop);
}

CameraLoop::CameraLoop(CameraLoopOptions options, std::unique_ptr<FrameSource> source, Clock& clock,
                       CameraCallbacks callbacks)
    : worker_(std::make_unique<Worker>(std::move(options), std::move(source), clock, std::move(callbacks))) {}
CameraLoop::~CameraLoop() = default;

void CameraLoop::start() {
  worker_->start();
}
void CameraLoop::request_stop() {
  worker_->request_stop();
}
void CameraLoop::join() {
  worker_->join();
}
CameraStatus CameraLoop::status() const {
  return worker_->status();
}
void CameraLoop::note_mor(std::optional<double> mor_m) {
  worker_->note_mor(mor_m);
}

}  // namespace lampglow::daemon
