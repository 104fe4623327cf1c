#include "daemon/station/stop_while_busy.h"

#include <pthread.h>
#include <signal.h>

#include <ctime>

namespace lampglow::daemon {

StopWhileBusy::StopWhileBusy() : thread_([this](const std::stop_token& closed) { watch(closed); }) {}

int StopWhileBusy::close() {
  thread_ = {};  // joined
  return signal_;
}

void StopWhileBusy::watch(const std::stop_token& closed) {
  pthread_setname_np(pthread_self(), "signals");  // for `top -H`
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT}) sigaddset(&signals, signal);
  while (!closed.stop_requested() && signal_ == 0) {
    constexpr timespec kLook{0, 50'000'000};  // how long close() may have to wait
    if (const int signal = sigtimedwait(&signals, nullptr, &kLook); signal > 0) signal_ = signal;
  }
  if (signal_ != 0) stop_.request_stop();
}

}  // namespace lampglow::daemon
