// A replay that answers over HTTP while it runs and after it: the newest frame is the current one.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "daemon/replay/replay.h"

namespace lampglow::daemon {

struct ReplayServerOptions {
  std::uint16_t port = 8080;  // on 127.0.0.1; 0: any free one
  std::optional<std::filesystem::path> database;
  std::string version;
};

class ReplayServer {
 public:
  // Listens on 127.0.0.1. Throws IoError where the port is taken.
  explicit ReplayServer(const ReplayServerOptions& options);
  ~ReplayServer();
  ReplayServer(const ReplayServer&) = delete;
  ReplayServer& operator=(const ReplayServer&) = delete;

  std::uint16_t port() const;
  void set_site(const Site& site);
  void publish(const FrameResult& result);
  // Shows the archive's last estimated frame, plain and annotated.
  void show_last_picture(const ReplayOptions& options, const ReplayResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::daemon
