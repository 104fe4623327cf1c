// Answers from memory.
#include <functional>

#include "web/answers.h"
#include "web/json_parts.h"
#include "web/static_files.h"

namespace lampglow::web {

Response json_answer(std::string body, int max_age_s) {
  Response response;
  response.content_type = "application/json";
  response.headers.emplace_back("Cache-Control",
                                max_age_s ? "private, max-age=" + std::to_string(max_age_s) : "no-store");
  response.body = std::move(body);
  return response;
}

Response with_etag(Response response, const Request& request, const std::string& etag) {
  response.headers.emplace_back("ETag", etag);
  if (request.if_none_match != "*" && request.if_none_match.find(etag) == std::string::npos) return response;
  response.status = 304;
  response.body.clear();
  response.shared_body.reset();
  return response;
}

// Tells versions of one answer apart, no more: the standard library's hash is quick over megabytes of a year.
std::string hash_etag(std::string_view body) {
  const std::uint64_t hash = std::hash<std::string_view>{}(body);
  constexpr char kHex[] = "0123456789abcdef";
  std::string out = "\"";
  for (int shift = 60; shift >= 0; shift -= 4) out += kHex[(hash >> shift) & 15];
  return out + "\"";
}

storage::CameraRecord camera_of(const Call& call) {
  const std::string name = call.query.text("camera");
  auto camera = call.live.camera(name);
  if (!camera) throw NotFound(name.empty() ? "no camera is configured" : "there is no camera " + name);
  return *camera;
}

Response current(const Call& call) {
  const storage::CameraRecord camera = camera_of(call);
  auto now = call.live.current(camera.name);
  if (!now) {
    Response waiting = problem(503, "camera " + camera.name + " has given no frame yet");
    waiting.headers.emplace_back("Retry-After", "5");
    return waiting;
  }
  Response response = json_answer(std::move(now->body), now->max_age_s);
  response.content_type = "application/geo+json";
  return with_etag(std::move(response), call.request, now->etag);
}

Response cameras(const Call& call) {
  std::string body = "{\"cameras\":[";
  for (const storage::CameraRecord& camera : call.live.cameras()) {
    const auto latest = call.live.latest_result(camera.name);
    if (body.back() != '[') body += ',';
    body += camera_json(camera, call.live.health(camera.name).value_or(CameraHealth{}),
                        latest ? std::optional(latest->observation.time_utc) : std::nullopt);
  }
  return json_answer(body + "]}");
}

Response latest_frame(const Call& call) {
  const storage::CameraRecord camera = camera_of(call);
  const bool annotated = call.query.boolean("annotated");
  const auto picture = call.live.picture(camera.name);
  const auto bytes = !picture ? nullptr : annotated ? picture->annotated_jpeg : picture->plain_jpeg;
  if (!bytes) throw NotFound("camera " + camera.name + " has given no picture yet");
  Response response;
  response.content_type = "image/jpeg";
  response.headers.emplace_back("Cache-Control", "private, no-cache");
  response.headers.emplace_back("Last-Modified", http_date(picture->time_utc));
  response.shared_body = bytes;
  return with_etag(std::move(response), call.request,
                   "\"" + percent_encode(camera.name) + "/" + format_time_utc(picture->time_utc) +
                       (annotated ? "/a\"" : "\""));
}

Response stream_head(const Call&) {
  Response response;
  response.content_type = "text/event-stream";
  response.headers.emplace_back("Cache-Control", "no-store");
  response.headers.emplace_back("X-Accel-Buffering", "no");  // nginx in front must not hold messages back
  return response;
}

Response healthz(const Call& call) {
  const std::vector<std::string> found = call.live.faults();
  json::array faults;
  if (call.trusted)  // the words name cameras
    for (const std::string& fault : found) faults.emplace_back(fault);
  return json_answer(
      json_text(json::object{{"status", found.empty() ? "ok" : "degraded"}, {"faults", faults}}));
}

Response readyz(const Call& call) {
  const std::string reason = call.live.not_ready();
  return reason.empty() ? json_answer("{\"status\":\"ready\"}") : problem(503, "not ready: " + reason);
}

Response metrics(const Call& call) {
  Response response;
  response.content_type = "text/plain; version=0.0.4; charset=utf-8";
  response.headers.emplace_back("Cache-Control", "no-store");
  response.body = call.live.metrics();
  return response;
}

Response openapi(const Call& call) {
  Response response = json_answer(std::string(static_file("/openapi.json")->content), 3600);
  const std::string etag = hash_etag(response.body);
  return with_etag(std::move(response), call.request, etag);
}

Response static_answer(const Request& request, const std::string& path) {
  const auto file = static_file(path == "/" ? "/index.html" : path);
  if (!file || path == "/openapi.json") return problem(404, "there is nothing at " + path);
  Response response;
  response.content_type = file->content_type;
  response.headers.emplace_back("Cache-Control", "no-cache");
  response.headers.emplace_back(
      "Content-Security-Policy",
      "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; "
      "manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
  response.body = std::string(file->content);
  const std::string etag = hash_etag(response.body);
  return with_etag(std::move(response), request, etag);
}

}  // namespace lampglow::web
