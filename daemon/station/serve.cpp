#include <malloc.h>
#include <signal.h>

#include <ctime>
#include <memory>

#include "daemon/errors.h"
#include "daemon/station/log.h"
#include "daemon/station/notify.h"
#include "daemon/station/station.h"
#include "daemon/station/stop_while_busy.h"

namespace lampglow::daemon {
namespace {

// Between two frames a station needs next to nothing. glibc would keep what a frame needed: each thread has
// an arena of its own, and once a large block was freed, the next ones of its size come from there. So
// picture-sized blocks are mapped each on its own, and unmapped when freed; the rest shares two arenas. Costs
// a page fault for 4 KiB.
void use_little_memory() {
  mallopt(M_MMAP_THRESHOLD, 256 << 10);
  mallopt(M_TRIM_THRESHOLD, 256 << 10);
  mallopt(M_ARENA_MAX, 2);
}

// The signals that the main thread waits for; blocked before any other thread is there.
sigset_t block_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&signals, signal);
  pthread_sigmask(SIG_BLOCK, &signals, nullptr);
  return signals;
}

// The signal that came within a second; 0 for none.
int wait_a_second(const sigset_t& signals) {
  const timespec second{1, 0};
  const int signal = sigtimedwait(&signals, nullptr, &second);
  return signal > 0 ? signal : 0;
}

void refuse_start(int signal, const std::string& broken_off) {
  notify_stopping();
  throw EndedBySignal(signal, std::string("ended by ") + (signal == SIGINT ? "SIGINT" : "SIGTERM") +
                                  " before the station was ready; nothing was measured" + broken_off);
}

// Checking the database and learning the references may take minutes; a signal to end is not kept waiting.
std::unique_ptr<Station> make_station(const std::filesystem::path& config_file) {
  StopWhileBusy stop;
  std::unique_ptr<Station> station;
  std::string broken_off;
  try {
    station = std::make_unique<Station>(read_station_config(config_file), stop.token());
  } catch (const Stopped& stopped) {
    broken_off = std::string(": ") + stopped.what();
  }
  if (const int signal = stop.close()) refuse_start(signal, broken_off);
  return station;
}

// SIGTERM or SIGINT if one came meanwhile; 0 for none. The old configuration then stays for what is left.
int reload(Station& station, const std::filesystem::path& file) {
  StopWhileBusy stop;
  notify_reloading();
  try {
    for (const std::string& key : station.reload(read_station_config(file), stop.token()))
      log(LogLevel::warning, "changed in the configuration, but only a restart takes it over",
          {{"key", key}});
    log(LogLevel::info, "configuration reloaded", {{"file", file.string()}});
  } catch (const std::exception& error) {
    log(LogLevel::error, "the new configuration cannot be used; the old one stays",
        {{"reason", error.what()}});
  }
  notify_ready();
  return stop.close();
}

void feed_watchdog(const Station& station) {
  const std::string why = station.stuck();
  if (why.empty())
    notify_watchdog();
  else
    log(LogLevel::error, "no progress; the watchdog is not fed", {{"reason", why}});
}

}  // namespace

void serve(const std::filesystem::path& config_file) {
  use_little_memory();
  open_log(LogLevel::info);
  const sigset_t signals = block_signals();
  const std::unique_ptr<Station> station = make_station(config_file);
  station->start();
  notify_ready();
  const bool watched = watchdog_period().has_value();
  for (;;) {
    int signal = wait_a_second(signals);
    if (signal == SIGHUP) signal = reload(*station, config_file);
    if (signal == SIGTERM || signal == SIGINT) break;
    station->look_after();
    notify_status(station->status_text());
    if (watched) feed_watchdog(*station);
  }
  notify_stopping();
  station->stop();
}

}  // namespace lampglow::daemon
