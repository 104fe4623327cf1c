#include "daemon/replay/stop_on_signal.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>

#include <cerrno>
#include <condition_variable>
#include <cstdint>
#include <mutex>

#include "daemon/errors.h"

namespace lampglow::daemon {
namespace {

sigset_t stop_signals() {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGTERM);
  return set;
}

}  // namespace

StopOnSignal::StopOnSignal() {
  const sigset_t set = stop_signals();
  pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signals_ = Descriptor(::signalfd(-1, &set, SFD_CLOEXEC));
  leave_ = Descriptor(::eventfd(0, EFD_CLOEXEC));
  if (!signals_.good() || !leave_.good()) throw IoError("no descriptor for signals is left");
  thread_ = std::thread([this] { watch(); });
}

StopOnSignal::~StopOnSignal() {
  const std::uint64_t one = 1;
  if (::write(leave_.get(), &one, sizeof one) == sizeof one)
    thread_.join();
  else
    thread_.detach();
  const sigset_t set = stop_signals();
  pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
}

void StopOnSignal::wait() const {
  std::mutex mutex;
  std::condition_variable_any changed;
  std::unique_lock lock(mutex);
  changed.wait(lock, token(), [] { return false; });
}

void StopOnSignal::watch() {
  pollfd waiting[2] = {{signals_.get(), POLLIN, 0}, {leave_.get(), POLLIN, 0}};
  while (::poll(waiting, 2, -1) < 0 && errno == EINTR) {
  }
  if (waiting[1].revents != 0) return;
  signalfd_siginfo info{};
  if (::read(signals_.get(), &info, sizeof info) < 0) return;
  // From here on this thread takes the signals' default action: the end.
  const sigset_t set = stop_signals();
  pthread_sigmask(SIG_UNBLOCK, &set, nullptr);
  stop_.request_stop();
  while (::poll(waiting + 1, 1, -1) < 0 && errno == EINTR) {
  }
}

}  // namespace lampglow::daemon
