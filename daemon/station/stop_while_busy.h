// SIGTERM and SIGINT while the main thread, which else waits for them, is busy for long: with a start, with a
// reload.
#pragma once

#include <stdexcept>
#include <stop_token>
#include <thread>

namespace lampglow::daemon {

// Thrown when a stop was asked for before the work was done; what() is what was broken off.
struct Stopped : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Takes the two signals for as long as it lives. Every thread must block them, so that none but its own gets
// them.
class StopWhileBusy {
 public:
  StopWhileBusy();
  StopWhileBusy(const StopWhileBusy&) = delete;
  StopWhileBusy& operator=(const StopWhileBusy&) = delete;

  std::stop_token token() const { return stop_.get_token(); }
  // Ends the watch. The signal that came, which is then the caller's to obey; 0 for none.
  int close();

 private:
  void watch(const std::stop_token& closed);

  std::stop_source stop_;
  int signal_ = 0;  // the thread's, while it runs
  std::jthread thread_;
};

}  // namespace lampglow::daemon
