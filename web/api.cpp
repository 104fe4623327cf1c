#include "web/api.h"

#include <array>

#include "web/answers.h"
#include "web/tokens.h"

namespace lampglow::web {
namespace {

using Parameters = std::span<const std::string_view>;
constexpr std::array<std::string_view, 1> kCamera = {"camera"};
constexpr std::array<std::string_view, 2> kCameraTime = {"camera", "time"};
constexpr std::array<std::string_view, 2> kCameraAnnotated = {"camera", "annotated"};
constexpr std::array<std::string_view, 7> kObservations = {"camera", "from",   "to",    "step",
                                                           "limit",  "cursor", "format"};
constexpr std::array<std::string_view, 4> kFrames = {"camera", "from", "to", "limit"};
constexpr std::array<std::string_view, 4> kEvents = {"after", "from", "to", "limit"};
constexpr Parameters kNone;

struct Entry {
  Route route;
  Response (*answer)(const Call&);
};

using Kind = Route::Kind;
constexpr Entry kEntries[] = {
    {{"/v1/current", kCamera, Kind::memory}, current},
    {{"/v1/observations", kObservations, Kind::database}, observations},
    {{"/v1/cameras", kNone, Kind::memory}, cameras},
    {{"/v1/lights", kCamera, Kind::database}, lights},
    {{"/v1/lights/{light}/profile", kCameraTime, Kind::database}, light_profile},
    {{"/v1/frames/latest.jpg", kCameraAnnotated, Kind::memory, true}, latest_frame},
    {{"/v1/frames", kFrames, Kind::database, true}, stored_frames},
    {{"/v1/frames/{camera}/{file}", kNone, Kind::database, true}, stored_frame},
    {{"/v1/events", kEvents, Kind::database}, events},
    {{"/v1/stream", kNone, Kind::stream}, stream_head},
    {{"/healthz", kNone, Kind::memory, false, true}, healthz},
    {{"/readyz", kNone, Kind::memory, false, true}, readyz},
    {{"/metrics", kNone, Kind::memory}, metrics},
    {{"/openapi.json", kNone, Kind::memory, false, true}, openapi},
};

// Takes the first segment off a path.
std::string_view take_segment(std::string_view& path) {
  path.remove_prefix(1);
  const std::string_view segment = path.substr(0, path.find('/'));
  path.remove_prefix(segment.size());
  return segment;
}

bool matches(std::string_view pattern, std::string_view path, std::map<std::string, std::string>& values) {
  values.clear();
  while (!pattern.empty() && !path.empty()) {
    const std::string_view expected = take_segment(pattern), segment = take_segment(path);
    if (expected.starts_with('{')) {
      if (segment.empty()) return false;
      values[std::string(expected.substr(1, expected.size() - 2))] = segment;
    } else if (expected != segment) {
      return false;
    }
  }
  return pattern.empty() && path.empty();
}

const Entry* find_entry(const std::string& path, std::map<std::string, std::string>& values) {
  for (const Entry& entry : kEntries)
    if (matches(entry.route.path, path, values)) return &entry;
  return nullptr;
}

bool needs_token(const Route& route, Protect protect) {
  if (protect == Protect::everything) return !route.open;
  return protect == Protect::pictures && route.pictures;
}

Response unauthorized() {
  Response response = problem(401, "a bearer token is needed: Authorization: Bearer TOKEN");
  response.headers.emplace_back("WWW-Authenticate", "Bearer realm=\"lampglow\"");
  return response;
}

Response wrong_method() {
  Response response = problem(405, "this interface is read only: GET and HEAD");
  response.headers.emplace_back("Allow", "GET, HEAD");
  return response;
}

}  // namespace

std::span<const Route> routes() {
  static const auto list = [] {
    std::array<Route, std::size(kEntries)> out{};
    for (size_t i = 0; i < out.size(); ++i) out[i] = kEntries[i].route;
    return out;
  }();
  return list;
}

Api::Api(LiveState& live, ApiOptions options)
    : live_(live), options_(std::move(options)), access_(std::make_shared<Access>(options_.access)) {}

void Api::set_access(Access access) {
  auto fresh = std::make_shared<const Access>(std::move(access));
  const std::scoped_lock lock(access_mutex_);
  access_.swap(fresh);
}

std::shared_ptr<const Access> Api::access() const {
  const std::scoped_lock lock(access_mutex_);
  return access_;
}

Route::Kind Api::kind(const Request& request) const {
  try {
    std::map<std::string, std::string> values;
    const Entry* entry = find_entry(parse_target(request.target).path, values);
    if (!entry) return Kind::memory;
    if (entry->route.kind == Kind::stream && request.method != "GET") return Kind::memory;
    return entry->route.kind == Kind::database && !options_.database ? Kind::memory : entry->route.kind;
  } catch (const BadRequest&) {
    return Kind::memory;
  }
}

Response Api::answer(const Request& request, storage::Reader* reader) const {
  try {
    return route(request, reader);
  } catch (const BadRequest& error) {
    return problem(400, error.what());
  } catch (const NotFound& error) {
    return problem(404, error.what());
  } catch (const storage::StorageError&) {
    // The message names files of the station: it is for the log, not for clients.
    return problem(503, "the database cannot be read at the moment");
  } catch (const std::exception&) {
    return problem(500, "an internal error; see the station's log");
  }
}

Response Api::route(const Request& request, storage::Reader* reader) const {
  if (request.method != "GET" && request.method != "HEAD") return wrong_method();
  const Target target = parse_target(request.target);
  std::map<std::string, std::string> values;
  const Entry* entry = find_entry(target.path, values);
  if (!entry) return static_answer(request, target.path);
  const std::shared_ptr<const Access> access = this->access();
  const bool known = token_allowed(request.authorization, access->token_hashes);
  if (needs_token(entry->route, access->protect) && !known) return unauthorized();
  const bool trusted = known || access->protect != Protect::everything;
  const Query query(target, entry->route.query);
  return entry->answer({request, target, query, values, live_, reader, options_, trusted});
}

}  // namespace lampglow::web
