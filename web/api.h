// The HTTP interface: from a request to an answer, without sockets. web/openapi.json describes it; a test
// holds the two together.
#pragma once

#include <filesystem>
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

struct ApiOptions {
  std::optional<std::filesystem::path> database;  // empty: only what is in memory
  std::filesystem::path pictures;                 // the folder of kept pictures
  Protect protect = Protect::nothing;
  std::vector<std::string> token_hashes;  // SHA-256, 64 hexadecimal digits each
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
  Api(LiveState& live, ApiOptions options) : live_(live), options_(std::move(options)) {}

  // What answering takes: the server answers `memory` at once, gives `database` to a thread with a reader,
  // and keeps the connection of a `stream`. Bad requests are `memory`.
  Route::Kind kind(const Request& request) const;

  // Never throws. `reader` may be null where kind() is not `database`. A stream's answer is its head, status
  // 200 with an empty body, if it is allowed.
  Response answer(const Request& request, storage::Reader* reader) const;

  const ApiOptions& options() const { return options_; }

 private:
  Response route(const Request& request, storage::Reader* reader) const;

  LiveState& live_;
  ApiOptions options_;
};

// Messages for a client that was away for longer than the memory reaches: the observations since, from the
// database, oldest first, at most `limit` for each camera. They carry no id.
std::string missed_messages(const LiveState& live, storage::Reader& reader, const StreamPosition& position,
                            int limit);

}  // namespace lampglow::web
