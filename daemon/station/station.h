// The station: cameras, workers, the keeper of the database and the HTTP server, wired together.
#pragma once

#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/station/config.h"

namespace lampglow::daemon {

class Station {
 public:
  // Opens database, sources and the port. Throws ConfigError, DataError, IoError with what is wrong; Stopped
  // soon after `stop` asked for it.
  Station(const StationConfig& config, const std::stop_token& stop);
  ~Station();  // stops, storing everything
  Station(const Station&) = delete;
  Station& operator=(const Station&) = delete;

  void start();
  void stop();
  // Takes over what can be taken over while running; returns the keys that only a restart changes. Throws
  // what the constructor throws, Stopped too; then nothing has changed.
  std::vector<std::string> reload(const StationConfig& config, const std::stop_token& stop);

  unsigned short port() const;
  std::string status_text() const;
  // Do scheduler, workers and writer all move on? Why not, in words; empty: they do.
  std::string stuck() const;
  // To be called about once a second by the main thread: passes the cameras' health on.
  void look_after();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// `lampglow serve`: runs until SIGTERM or SIGINT; SIGHUP reloads. Returns at the end; throws what Station
// throws, and EndedBySignal if one of the two came before it was ready.
void serve(const std::filesystem::path& config_file);

}  // namespace lampglow::daemon
