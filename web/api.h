// The HTTP interface: from a request to an answer, without sockets. web/openapi.json describes it; a test
// holds the two together.
#pragma once

#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "storage/reader.h"
#include "web/http.h"
#include "web/live_state.h"

namespace lampglow::web {

enum class Protect { nothing, pictures, everything };  // what needs a bearer token

struct Access {
  Protect protect = Protect::nothing;
  std::vector<std::string> token_hashes;  // SHA-256, 64 hexadecimal digits each
  bool operator==(const Access&) const = default;
};

struct ApiOptions {
  std::optional<std::filesystem::path> database;  // empty: only what is in memory
  std::filesystem::path pictures;                 // the folder of kept pictures
  Access access;
};

// A path of the interface; {name} stands for one segment. The server's whole routing table.
struct Route {
  enum class Kind { memory, database, stream };  // where the answer comes from
  std::string_view path;
  std::span<const std::string_view> query;  // parameters it knows
  Kind kind = Kind::memory;
  bool pictures = false;
  bool open = false;  // needs no token even when everything is protected: holds no data
};

std::span<const Route> routes();

class Api {
 public:
  Api(LiveState& live, ApiOptions options);

  // What answering takes: the server answers `memory` at once, gives `database` to a thread with a reader,
  // and keeps the connection of a `stream`. Bad requests are `memory`.
  Route::Kind kind(const Request& request) const;

  // Never throws. `reader` may be null where kind() is not `database`. A stream's answer is its head, status
  // 200 with an empty body, if it is allowed.
  Response answer(const Request& request, storage::Reader* reader) const;

  const ApiOptions& options() const { return options_; }  // its access is the one at the start

  // From any thread; requests that are answered later see it.
  void set_access(Access access);

 private:
  std::shared_ptr<const Access> access() const;
  Response route(const Request& request, storage::Reader* reader) const;

  LiveState& live_;
  ApiOptions options_;
  mutable std::mutex access_mutex_;
  std::shared_ptr<const Access> access_;  // answered by several threads
};

// Messages for a client that was away for longer than the memory reaches: the observations since (and some
// minutes before, which it may have: it knows them by camera and time), from the database, oldest first, the
// newest `limit` of each camera within a day. They carry no id.
std::string missed_messages(const LiveState& live, storage::Reader& reader, const StreamPosition& position,
                            int limit);

}  // namespace lampglow::web
