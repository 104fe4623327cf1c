// Answers from the database.
#include <algorithm>
#include <array>
#include <fstream>
#include <map>
#include <sstream>

#include "storage/means.h"
#include "web/answers.h"

namespace lampglow::web {
namespace {

using storage::CameraRecord;
using storage::ObservationRow;

constexpr int kDefaultRows = 1000;
constexpr int kMostRows = 10000;

storage::Reader& reader_of(const Call& call) {
  if (!call.reader) throw NotFound("this station keeps no database");
  return *call.reader;
}

// The camera as the database numbers it.
CameraRecord stored_camera(const Call& call) {
  const std::string name = camera_of(call).name;
  auto camera = reader_of(call).camera(name);
  if (!camera) throw NotFound("camera " + name + " has stored nothing yet");
  return *camera;
}

int period_of(const Call& call) {
  static constexpr std::array<std::string_view, 4> kSteps = {"raw", "1min", "10min", "hour"};
  const std::string step = call.query.one_of("step", kSteps);
  return step == "raw" ? 0 : step == "1min" ? 60 : step == "10min" ? 600 : 3600;
}

// By `format`, else by the Accept header.
std::string format_of(const Call& call) {
  static constexpr std::array<std::string_view, 3> kFormats = {"json", "csv", "geojson"};
  if (call.query.text("format").empty()) {
    if (call.request.accept.find("text/csv") != std::string::npos) return "csv";
    if (call.request.accept.find("application/geo+json") != std::string::npos) return "geojson";
  }
  return call.query.one_of("format", kFormats);
}

// An hour past now, so that the newest row and its means are in the half-open range. Asked for nothing at
// all, a camera that ended long ago (an archive) shows its last day, not an empty one.
TimePoint default_end(const Call& call, const CameraRecord& camera) {
  const TimePoint now = call.live.now();
  const auto span = call.query.time("from") ? std::nullopt : reader_of(call).span(camera.number);
  return std::chrono::hours(1) + (span ? std::min(now, span->second) : now);
}

storage::ObservationQuery query_of(const Call& call, const CameraRecord& camera) {
  storage::ObservationQuery query;
  query.camera = camera.number;
  const auto to = call.query.time("to");
  query.to = to ? *to : default_end(call, camera);
  query.from = call.query.time("from").value_or(query.to - std::chrono::hours(25));
  if (query.from >= query.to) throw BadRequest("from: expected a time before to");
  query.period_s = period_of(call);
  query.limit = static_cast<int>(call.query.integer("limit", 1, kMostRows).value_or(kDefaultRows));
  constexpr std::int64_t kLastMs = 253402300799999;  // year 9999
  if (const auto cursor = call.query.integer("cursor", -kLastMs, kLastMs))
    query.after = TimePoint{std::chrono::milliseconds{*cursor}};
  return query;
}

// The same path with these parameters.
std::string same_with(const Call& call, const std::map<std::string, std::string>& parameters) {
  std::string out = call.target.path;
  char separator = '?';
  for (const auto& [key, value] : parameters) {
    out += separator + percent_encode(key) + "=" + percent_encode(value);
    separator = '&';
  }
  return out;
}

// The same request for the next page.
std::string next_page(const Call& call, const storage::ObservationQuery& query, TimePoint last) {
  auto parameters = call.target.query;
  parameters["from"] = format_time_utc(query.from);
  parameters["to"] = format_time_utc(query.to);
  parameters["cursor"] = std::to_string(last.time_since_epoch().count());
  return same_with(call, parameters);
}

std::string json_rows(const CameraRecord& camera, const std::vector<ObservationRow>& rows,
                      const std::string& next) {
  std::string body = "{\"camera\":" + json_string(camera.name) +
                     ",\"station\":" + json_string(camera.station) + ",\"observations\":[";
  body.reserve(body.size() + rows.size() * 420);
  for (const ObservationRow& row : rows) {
    if (body.back() != '[') body += ',';
    append_observation_json(body, row);
  }
  return body + "],\"next\":" + (next.empty() ? "null" : "\"" + next + "\"") + "}";
}

std::string geojson_rows(const CameraRecord& camera, const std::vector<ObservationRow>& rows,
                         const std::string& next) {
  std::string body = "{\"type\":\"FeatureCollection\",\"features\":[";
  for (const ObservationRow& row : rows) {
    if (body.back() != '[') body += ',';
    body += observation_feature(camera, row);
  }
  return body + "],\"pagination\":" + (next.empty() ? "null" : "{\"next\":\"" + next + "\"}") + "}";
}

std::string csv_rows(const CameraRecord& camera, const std::vector<ObservationRow>& rows) {
  std::string body = observation_csv_header();
  for (const ObservationRow& row : rows) body += observation_csv(camera, row);
  return body;
}

// Empty if it cannot be read.
std::string whole_file(const std::filesystem::path& path) {
  std::ifstream stream(path, std::ios::binary);
  std::ostringstream out;
  out << stream.rdbuf();
  return std::move(out).str();
}

const LampFit* fit_of(const std::vector<LampFit>& fits, const std::string& id) {
  for (const LampFit& fit : fits)
    if (fit.id == id) return &fit;
  return nullptr;
}

}  // namespace

Response observations(const Call& call) {
  const CameraRecord camera = stored_camera(call);
  const storage::ObservationQuery query = query_of(call, camera);
  const std::vector<ObservationRow> rows = reader_of(call).observations(query);
  const std::string next = std::ssize(rows) == query.limit && !rows.empty()
                               ? next_page(call, query, rows.back().observation.time_utc)
                               : "";
  const std::string format = format_of(call);
  Response response = json_answer(format == "csv"       ? csv_rows(camera, rows)
                                  : format == "geojson" ? geojson_rows(camera, rows, next)
                                                        : json_rows(camera, rows, next),
                                  10);
  if (format == "csv") response.content_type = "text/csv; charset=utf-8";
  if (format == "geojson") response.content_type = "application/geo+json";
  if (!next.empty()) response.headers.emplace_back("Link", "<" + next + ">; rel=\"next\"");
  response.headers.emplace_back("Vary", "Accept");
  const std::string etag = hash_etag(response.body);
  return with_etag(std::move(response), call.request, etag);
}

// The catalogue from memory. A lamp's state is what the current frame says; where that is stale or has no
// lamps, it is unknown, and the last fit says what it is of.
Response lights(const Call& call) {
  const CameraRecord camera = camera_of(call);
  const auto stored = call.reader ? call.reader->camera(camera.name) : std::nullopt;
  std::vector<LampFit> fits;
  std::optional<TimePoint> time;
  if (const auto latest = call.live.latest_result(camera.name); latest && !latest->lamps.empty()) {
    fits = latest->lamps;
    time = latest->observation.time_utc;
  } else if (stored) {
    for (const storage::LampFitRow& row : call.reader->fits(stored->number)) {
      fits.push_back(row.fit);
      time = row.time_utc;
    }
  }
  const auto latest = call.live.latest_result(camera.name);
  const bool current = call.live.is_fresh(camera.name) && latest && time == latest->observation.time_utc;
  std::map<std::string, TimePoint> since;
  if (stored)
    for (const storage::LampRecord& lamp : call.reader->lamps(stored->number))
      if (lamp.reference_since) since[lamp.id] = *lamp.reference_since;
  std::string body = "{\"lights\":[";
  for (storage::LampRecord lamp : call.live.lamps(camera.name)) {
    if (const auto found = since.find(lamp.id); found != since.end()) lamp.reference_since = found->second;
    if (body.back() != '[') body += ',';
    body += light_json(lamp, fit_of(fits, lamp.id), time, current);
  }
  return json_answer(body + "]}");
}

Response light_profile(const Call& call) {
  const CameraRecord camera = camera_of(call);
  const std::string& lamp = call.path.at("light");
  const auto time = call.query.time("time");
  const auto latest = call.live.latest_result(camera.name);
  if (latest && (!time || *time == latest->observation.time_utc))
    if (const LampFit* fit = fit_of(latest->lamps, lamp); fit && !fit->profile.theta_deg.empty())
      return json_answer(profile_json(lamp, latest->observation.time_utc, fit->profile));
  if (call.reader)
    if (const auto stored = call.reader->camera(camera.name))
      if (const auto rings = call.reader->rings(stored->number, lamp, time))
        return json_answer(profile_json(lamp, rings->first, rings->second));
  throw NotFound("no ring profile of light " + lamp + " is kept" + (time ? " for that time" : ""));
}

// A page ends between two times, so that the next one begins where it ended: several cameras may have kept a
// picture at the same time.
Response stored_frames(const Call& call) {
  const std::string name = call.query.text("camera");
  const TimePoint to = call.query.time("to").value_or(call.live.now() + std::chrono::hours(1));
  const TimePoint from = call.query.time("from").value_or(to - std::chrono::hours(24 * 7));
  const int limit = static_cast<int>(call.query.integer("limit", 1, kMostRows).value_or(kDefaultRows));
  const std::vector<storage::PictureRecord> pictures =
      reader_of(call).pictures(name.empty() ? std::nullopt : std::optional(name), from, to, limit);
  std::string body = "{\"frames\":[";
  for (const storage::PictureRecord& picture : pictures) {
    if (body.back() != '[') body += ',';
    body += picture_json(picture);
  }
  std::string next = "null";
  if (std::ssize(pictures) >= limit) {
    auto parameters = call.target.query;
    parameters["from"] = format_time_utc(pictures.back().time_utc + std::chrono::milliseconds(1));
    parameters["to"] = format_time_utc(to);
    next = json_string(same_with(call, parameters));
  }
  return json_answer(body + "],\"next\":" + next + "}");
}

Response stored_frame(const Call& call) {
  const std::string& camera = call.path.at("camera");
  const std::string& file = call.path.at("file");
  const std::string nothing = "no picture " + file + " of camera " + camera + " is kept";
  if (!file.ends_with(".jpg")) throw NotFound(nothing);
  const auto named = parse_time_utc(file.substr(0, file.size() - 4));
  if (!named) throw NotFound(nothing);
  const TimePoint time = *named;
  // Only what the database lists is opened, by a name made here.
  if (reader_of(call).pictures(camera, time, time + std::chrono::milliseconds(1), 1).empty())
    throw NotFound(nothing);
  Response response;
  response.content_type = "image/jpeg";
  response.headers.emplace_back("Cache-Control", "private, max-age=86400, immutable");
  response.body =
      whole_file(call.options.pictures / camera / (std::to_string(time.time_since_epoch().count()) + ".jpg"));
  if (response.body.empty()) throw NotFound("the picture's file is gone");
  return with_etag(std::move(response), call.request,
                   "\"" + percent_encode(camera) + "/" + percent_encode(file) + "\"");
}

Response events(const Call& call) {
  const int limit = static_cast<int>(call.query.integer("limit", 1, kMostRows).value_or(100));
  const auto after = call.query.integer("after", 0, INT64_MAX);
  const auto from = call.query.time("from"), to = call.query.time("to");
  const auto rows = after || from || to ? reader_of(call).events(after.value_or(0), limit, from, to)
                                        : reader_of(call).last_events(limit);
  std::string body = "{\"events\":[";
  for (const storage::Event& event : rows) {
    if (body.back() != '[') body += ',';
    body += event_json(event);
  }
  return json_answer(body + "]}");
}

// Messages do not come in the order of their times: a camera's frame may be told some minutes after
// another's.
std::string missed_messages(const LiveState& live, storage::Reader& reader, const StreamPosition& position,
                            int limit) {
  constexpr std::chrono::minutes kOverlap{10};
  constexpr std::chrono::hours kLongest{24};
  const TimePoint from = std::max(position.time_utc - kOverlap, live.now() - kLongest);
  std::string out;
  for (const CameraRecord& known : live.cameras()) {
    const auto camera = reader.camera(known.name);
    if (!camera) continue;
    const storage::ObservationQuery query{camera->number, from, live.now() + std::chrono::hours(1), 0, {},
                                          limit,          true};
    for (const ObservationRow& row : reader.observations(query))
      out += "event: observation\ndata: " + observation_feature(*camera, row) + "\n\n";
  }
  return out;
}

}  // namespace lampglow::web
