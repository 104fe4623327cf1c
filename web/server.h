// The HTTP server: Boost.Beast with coroutines on one thread of its own, and two threads for the database.
#pragma once

#include <chrono>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "storage/file_id.h"
#include "web/api.h"
#include "web/live_state.h"

namespace lampglow::web {

struct TlsFiles {
  std::filesystem::path certificate;  // PEM chain; empty: plain HTTP
  std::filesystem::path key;          // PEM
  bool operator==(const TlsFiles&) const = default;
};

struct ServerOptions {
  std::string address = "127.0.0.1";  // an IP address; 0.0.0.0 or :: for all
  unsigned short port = 8080;         // 0: any free one, see port()
  TlsFiles tls;
  int max_connections = 4096;
  int max_connections_per_address = 256;  // IPv6: per /64
  int max_header_bytes = 8192;
  int max_body_bytes = 1024;                       // a GET needs none
  std::size_t max_large_answers_bytes = 64 << 20;  // of the database, over 256 KiB each, that are being sent
  std::chrono::seconds header_timeout{10};  // a whole request, from its first byte or the connection's start
  std::chrono::seconds keep_alive_timeout{60};  // between requests
  std::chrono::seconds write_timeout{20};       // 64 KiB of an answer, or one stream message
  std::chrono::seconds stream_heartbeat{15};    // a comment line, so that both ends notice a dead connection
};

class Server {
 public:
  // Binds and listens; throws std::runtime_error saying which address or file failed. `live` must outlive it.
  Server(const ServerOptions& options, LiveState& live, const ApiOptions& api);
  ~Server();  // stops
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  void start();
  void stop();  // closes all connections; returns in well under a second
  unsigned short port() const;

  // From any thread. Connections that are open keep their certificate; new ones get what the files hold now.
  // Throws std::runtime_error saying which file is of no use; the old certificate then stays. Not from plain
  // HTTP to TLS or back.
  void set_tls(const TlsFiles& files);
  // From any thread. Event streams are closed, so that their clients show a token that still holds.
  void set_access(Access access);
  // From any thread: the database file that is in use, see ReaderPool::use_only().
  void use_database(std::optional<storage::FileId> file);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::web
