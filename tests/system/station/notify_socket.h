// The socket that a program tells systemd how it is by (sd_notify).
#pragma once

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/system/station/serving.h"

namespace lampglow::testing {

// What systemd would hear.
class NotifySocket {
 public:
  explicit NotifySocket(const std::filesystem::path& path,
                        std::chrono::microseconds watchdog = std::chrono::minutes(1))
      : path_(path), socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path.string().copy(address.sun_path, sizeof address.sun_path - 1);
    if (::bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0)
      ADD_FAILURE() << "no socket at " << path;
    ::setenv("NOTIFY_SOCKET", path.c_str(), 1);
    ::setenv("WATCHDOG_USEC", std::to_string(watchdog.count()).c_str(), 1);
  }
  ~NotifySocket() {
    ::unsetenv("NOTIFY_SOCKET");
    ::unsetenv("WATCHDOG_USEC");
    ::close(socket_);
    std::filesystem::remove(path_);
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  // All that was said since the last call. Who does not listen makes the program wait.
  std::string heard() const {
    std::string all;
    char buffer[4096];
    for (ssize_t n = 0; (n = ::recv(socket_, buffer, sizeof buffer, 0)) > 0;)
      all.append(buffer, static_cast<std::size_t>(n)) += '\n';
    return all;
  }
  bool fed_within(std::chrono::milliseconds limit) const {
    return eventually(limit, [&] { return heard().find("WATCHDOG=1") != std::string::npos; });
  }

 private:
  std::filesystem::path path_;
  int socket_;
};

}  // namespace lampglow::testing
