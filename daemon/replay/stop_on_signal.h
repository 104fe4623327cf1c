// SIGINT and SIGTERM as a stop token. Make it before any other thread, so that all of them leave the signals
// to it. A second signal ends the program at once.
#pragma once

#include <stop_token>
#include <thread>

#include "daemon/config/descriptor.h"

namespace lampglow::daemon {

class StopOnSignal {
 public:
  StopOnSignal();
  ~StopOnSignal();
  StopOnSignal(const StopOnSignal&) = delete;
  StopOnSignal& operator=(const StopOnSignal&) = delete;

  std::stop_token token() const { return stop_.get_token(); }
  // Waits until a signal has come.
  void wait() const;

 private:
  void watch();

  std::stop_source stop_;
  Descriptor signals_;  // signalfd
  Descriptor leave_;    // eventfd: the destructor's word to the thread
  std::thread thread_;
};

}  // namespace lampglow::daemon
