// Holds web/openapi.json and the implementation against each other: the same paths and parameters on both
// sides, and every answer as its schema says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/json.hpp>
#include <fstream>
#include <set>

#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"
#include "web/api.h"
#include "web/metar.h"
#include "web/static_files.h"
#include "web/tokens.h"

namespace lampglow::web {
namespace {

namespace json = boost::json;
using namespace testing_support;

const json::object& document() {
  static const json::value parsed = json::parse(static_file("/openapi.json")->content);
  return parsed.as_object();
}

bool is_of_type(const json::value& value, std::string_view type) {
  if (type == "object") return value.is_object();
  if (type == "array") return value.is_array();
  if (type == "string") return value.is_string();
  if (type == "boolean") return value.is_bool();
  if (type == "null") return value.is_null();
  if (type == "number") return value.is_number();
  if (type == "integer") return value.is_int64() || value.is_uint64();
  return false;
}

bool type_fits(const json::value& value, const json::value& type) {
  if (type.is_string()) return is_of_type(value, type.as_string());
  for (const json::value& one : type.as_array())
    if (is_of_type(value, one.as_string())) return true;
  return false;
}

bool among(const json::value& value, const json::array& values) {
  return std::find(values.begin(), values.end(), value) != values.end();
}

// The part of JSON Schema that our file uses. Keys that the schema does not name are errors, too.
void validate(const json::value& value, const json::object& schema, const std::string& where) {
  if (const auto* ref = schema.if_contains("$ref")) {
    const std::string name =
        std::string(ref->as_string()).substr(std::string("#/components/schemas/").size());
    return validate(value, document().at("components").at("schemas").at(name).as_object(), where);
  }
  if (const auto* type = schema.if_contains("type")) {
    EXPECT_TRUE(type_fits(value, *type)) << where << ": " << value << " is not of type " << *type;
  }
  if (const auto* constant = schema.if_contains("const")) {
    EXPECT_EQ(value, *constant) << where;
  }
  if (const auto* choices = schema.if_contains("enum")) {
    EXPECT_TRUE(among(value, choices->as_array())) << where << ": " << value;
  }
  if (value.is_object() && schema.contains("properties")) {
    const json::object& properties = schema.at("properties").as_object();
    for (const auto& [key, member] : value.as_object()) {
      EXPECT_TRUE(properties.contains(key)) << where << "." << key << " is not in the schema";
      if (properties.contains(key))
        validate(member, properties.at(key).as_object(), where + "." + std::string(key));
    }
    if (const auto* required = schema.if_contains("required")) {
      for (const json::value& key : required->as_array()) {
        EXPECT_TRUE(value.as_object().contains(key.as_string())) << where << "." << key << " is missing";
      }
    }
  }
  if (value.is_array() && schema.contains("items"))
    for (const json::value& item : value.as_array())
      validate(item, schema.at("items").as_object(), where + "[]");
}

class OpenApiTest : public testing::Test {
 protected:
  OpenApiTest() {
    live.set_camera("quay", harbour());
    live.set_health("quay", {true, "", "", at("2026-11-22T01:00:30Z"), at("2026-11-22T01:01:30Z")});
    storage::Store store(directory / "x.db");
    const auto camera = store.upsert_camera("quay", harbour());
    for (int i = 0; i < 90; ++i)
      store.put(camera, foggy(at("2026-11-22T00:00:00Z") + std::chrono::seconds(40 * i)));
    store.put(camera, without_value(at("2026-11-22T01:00:10Z")));
    store.put_event({0, at("2026-11-22T00:10:00Z"), storage::EventKind::source_failed,
                     storage::Severity::warning, "quay", "x"});
    std::filesystem::create_directories(directory / "pictures" / "quay");
    const TimePoint time = at("2026-11-22T00:20:00Z");
    std::ofstream(directory / "pictures" / "quay" /
                  (std::to_string(time.time_since_epoch().count()) + ".jpg"))
        << "JPEG";
    store.put_picture(camera, {"quay", time, storage::KeptFor::hourly, 4});
    live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
    live.set_picture("quay", {time, std::make_shared<std::string>("J"), std::make_shared<std::string>("A")});
    live.set_not_ready("");
  }
  Response ask(const std::string& target, const std::string& accept = "",
               const std::string& authorization = "") {
    storage::Reader reader(directory / "x.db");
    return Api(live, options).answer({"GET", target, "", accept, authorization, ""}, &reader);
  }
  // The answer's content as JSON, checked against the schema of its path, status and content type.
  json::value checked(const std::string& path, const std::string& target) {
    const Response response = ask(target);
    const auto& described = document().at("paths").at(path).at("get").at("responses").as_object();
    const std::string status = std::to_string(response.status);
    EXPECT_TRUE(described.contains(status)) << target << " gave " << status << ": " << response.content();
    if (!described.contains(status)) return nullptr;
    const std::string type = response.content_type.substr(0, response.content_type.find(';'));
    const auto& content = described.at(status).at("content").as_object();
    EXPECT_TRUE(content.contains(type)) << target << " gave " << type;
    if (type.find("json") == std::string::npos || !content.contains(type)) return nullptr;
    json::value value = json::parse(response.content());
    validate(value, content.at(type).at("schema").as_object(), target);
    return value;
  }

  TemporaryDirectory directory;
  LiveState live{LiveOptions{.version = "test", .now = [] { return at("2026-11-22T01:00:40Z"); }}};
  ApiOptions options{directory / "x.db", directory / "pictures", {}};
};

TEST_F(OpenApiTest, HasThePathsAndParametersOfTheImplementationAndNoOthers) {
  std::set<std::string> described, implemented;
  for (const auto& [path, item] : document().at("paths").as_object()) {
    std::string line(path);
    std::set<std::string> names;
    if (const auto* parameters = item.at("get").as_object().if_contains("parameters"))
      for (const json::value& parameter : parameters->as_array())
        if (parameter.at("in") == "query") names.insert(std::string(parameter.at("name").as_string()));
    for (const auto& name : names) line += " " + name;
    described.insert(line);
  }
  for (const Route& route : routes()) {
    std::string line(route.path);
    for (const auto& name : std::set<std::string_view>(route.query.begin(), route.query.end()))
      line += " " + std::string(name);
    implemented.insert(line);
  }
  EXPECT_EQ(described, implemented);
}

TEST_F(OpenApiTest, EveryAnswerIsAsDescribed) {
  const json::value current = checked("/v1/current", "/v1/current");
  EXPECT_EQ(current.at("properties").at("camera"), "quay");
  EXPECT_EQ(checked("/v1/observations", "/v1/observations?limit=100").at("observations").as_array().size(),
            91u);
  EXPECT_EQ(checked("/v1/observations", "/v1/observations?format=geojson&step=1min")
                .at("features")
                .as_array()
                .size(),
            62u);
  checked("/v1/observations", "/v1/observations?format=csv");
  EXPECT_EQ(checked("/v1/cameras", "/v1/cameras").at("cameras").as_array().size(), 1u);
  EXPECT_EQ(checked("/v1/lights", "/v1/lights").at("lights").as_array().size(), 3u);
  EXPECT_EQ(checked("/v1/lights/{light}/profile", "/v1/lights/L1/profile").at("radiance").as_array().size(),
            3u);
  checked("/v1/lights/{light}/profile", "/v1/lights/L9/profile");
  EXPECT_EQ(checked("/v1/frames", "/v1/frames").at("frames").as_array().size(), 1u);
  checked("/v1/frames/{camera}/{file}", "/v1/frames/quay/2026-11-22T00:20:00Z.jpg");
  checked("/v1/frames/{camera}/{file}", "/v1/frames/quay/2026-11-22T00:20:01Z.jpg");
  checked("/v1/frames/latest.jpg", "/v1/frames/latest.jpg?annotated=true");
  EXPECT_EQ(checked("/v1/events", "/v1/events").at("events").as_array().size(), 1u);
  checked("/healthz", "/healthz");
  checked("/readyz", "/readyz");
  checked("/metrics", "/metrics");
  checked("/v1/current", "/v1/current?camera=attic");
  checked("/v1/events", "/v1/events?limit=-1");
}

TEST_F(OpenApiTest, KeptPicturesComeFromTheDatabaseAlone) {
  EXPECT_EQ(ask("/v1/frames/quay/2026-11-22T00:20:00Z.jpg").content(), "JPEG");
  EXPECT_EQ(ask("/v1/frames/..%2F..%2Fetc/passwd.jpg").status, 400);
  EXPECT_EQ(ask("/v1/frames/quay/..%2Fx.db").status, 400);
}

TEST_F(OpenApiTest, PagesFollowEachOtherToTheEnd) {
  std::string target = "/v1/observations?from=2026-11-22T00:00:00Z&to=2026-11-22T02:00:00Z&limit=40";
  std::vector<std::string> times;
  for (int page = 0; page < 10 && !target.empty(); ++page) {
    const json::value body = json::parse(ask(target).content());
    for (const json::value& row : body.at("observations").as_array())
      times.emplace_back(row.at("time_utc").as_string());
    target = body.at("next").is_null() ? "" : std::string(body.at("next").as_string());
  }
  EXPECT_EQ(times.size(), 91u);
  EXPECT_TRUE(std::is_sorted(times.begin(), times.end()));
  EXPECT_EQ(std::set<std::string>(times.begin(), times.end()).size(), 91u);
}

// Two cameras keep pictures at the same times: no page's end cuts such a pair.
TEST_F(OpenApiTest, PagesOfPicturesNeitherSkipNorDouble) {
  storage::Store store(directory / "x.db");
  const auto pier = store.upsert_camera("pier", harbour()), quay = store.upsert_camera("quay", harbour());
  for (int hour = 1; hour < 8; ++hour)
    for (const auto& [number, name] : {std::pair(pier, "pier"), std::pair(quay, "quay")})
      store.put_picture(
          number, {name, at("2026-11-21T00:00:00Z") + std::chrono::hours(hour), storage::KeptFor::hourly, 4});
  std::string target = "/v1/frames?from=2026-11-21T00:30:00Z&to=2026-11-21T12:00:00Z&limit=3";
  std::vector<std::string> seen;
  for (int page = 0; page < 20 && !target.empty(); ++page) {
    const json::value body = checked("/v1/frames", target);
    for (const json::value& frame : body.at("frames").as_array()) seen.push_back(json::serialize(frame));
    target = body.at("next").is_null() ? "" : std::string(body.at("next").as_string());
  }
  EXPECT_EQ(seen.size(), 14u);
  EXPECT_EQ(std::set<std::string>(seen.begin(), seen.end()).size(), 14u);
}

TEST_F(OpenApiTest, ALampsStateIsTheCurrentFramesAndElseUnknown) {
  const json::value now = checked("/v1/lights", "/v1/lights").at("lights").at(0);
  EXPECT_EQ(now.at("state"), "seen");
  EXPECT_EQ(now.at("referenceSince"), "2026-11-22T00:00:00Z");
  FrameResult failed;
  failed.observation.time_utc = at("2026-11-22T01:00:35Z");
  failed.reason = "connection_lost";
  live.publish("quay", failed);
  const json::value later = checked("/v1/lights", "/v1/lights").at("lights").at(0);
  EXPECT_EQ(later.at("state"), "unknown");
  EXPECT_FALSE(later.at("fit").is_null()) << "the last one, with its time";
}

TEST_F(OpenApiTest, WhoShowsNoTokenLearnsNoNamesFromHealthz) {
  live.set_fault("camera quay", "connection_lost");
  EXPECT_THAT(ask("/healthz").content(), testing::HasSubstr("camera quay"));
  options.access = {Protect::everything, {token_hash("a token")}};
  EXPECT_EQ(ask("/healthz").content(), "{\"status\":\"degraded\",\"faults\":[]}");
  EXPECT_THAT(ask("/healthz", "", "Bearer a token").content(), testing::HasSubstr("camera quay"));
}

TEST_F(OpenApiTest, CsvHasTheColumnsOfReplayFirst) {
  const Response response = ask("/v1/observations?limit=1", "text/csv");
  EXPECT_EQ(response.content_type, "text/csv; charset=utf-8");
  EXPECT_TRUE(
      response.body.starts_with("time_utc,mor_m,mor_low_m,mor_high_m,limit,extinction_per_m,q,q_low,q_high,"
                                "weather,method,lights_used,quality,"));
  EXPECT_THAT(response.body, testing::HasSubstr("2026-11-22T00:00:00Z,249.64"));
}

TEST_F(OpenApiTest, TokensProtectWhatTheyAreToProtect) {
  const std::string token = "a secret for this test";
  options.access.token_hashes = {"0000000000000000000000000000000000000000000000000000000000000000",
                                 token_hash(token)};
  for (const auto& [protect, path, open] : std::vector<std::tuple<Protect, std::string, bool>>{
           {Protect::pictures, "/v1/current", true},
           {Protect::pictures, "/v1/frames/latest.jpg", false},
           {Protect::pictures, "/v1/frames/quay/2026-11-22T00:20:00Z.jpg", false},
           {Protect::everything, "/v1/current", false},
           {Protect::everything, "/v1/stream", false},
           {Protect::everything, "/metrics", false},
           {Protect::everything, "/healthz", true},
           {Protect::everything, "/", true}}) {
    options.access.protect = protect;
    EXPECT_EQ(ask(path).status, open ? 200 : 401) << path;
    EXPECT_EQ(ask(path, "", "Bearer wrong").status, open ? 200 : 401) << path;
    EXPECT_EQ(ask(path, "", "Bearer " + token).status, 200) << path;
    EXPECT_EQ(ask(path, "", "bearer " + token).status, 200) << path << ": the scheme's case does not matter";
  }
}

TEST(Metar, RoundsDownAsAnnexThreeDoes) {
  const auto visibility = [](double mor_m, Limit limit = Limit::none) {
    Observation o = foggy(at("2026-11-22T01:00:00Z"), kMorTimesExtinction / mor_m).observation;
    o.limit = limit;
    return metar_visibility(o);
  };
  EXPECT_EQ(visibility(49), "0000");
  EXPECT_EQ(visibility(799), "0750");
  EXPECT_EQ(visibility(800), "0800");
  EXPECT_EQ(visibility(4999), "4900");
  EXPECT_EQ(visibility(9999), "9000");
  EXPECT_EQ(visibility(25000), "9999");
  EXPECT_EQ(visibility(3000, Limit::above), "////");
  EXPECT_EQ(visibility(12000, Limit::above), "9999");
  EXPECT_EQ(visibility(300, Limit::below), "////");
}

TEST(Metrics, LeaveOutWhatIsStale) {
  TimePoint now = at("2026-11-22T01:00:40Z");
  LiveState live(LiveOptions{.version = "1.2", .now = [&now] { return now; }});
  live.set_camera("quay", harbour());
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z"), 0.01), 0.2);
  EXPECT_THAT(live.metrics(), testing::HasSubstr("lampglow_visibility_meters{camera=\"quay\"} 299.5732"));
  EXPECT_THAT(live.metrics(),
              testing::HasSubstr("lampglow_frames_total{camera=\"quay\",result=\"value\"} 1\n"));
  EXPECT_THAT(live.metrics(),
              testing::HasSubstr("lampglow_fit_duration_seconds_bucket{camera=\"quay\",le=\"0.3\"} 1\n"));
  EXPECT_THAT(live.metrics(), testing::HasSubstr("lampglow_build_info{version=\"1.2\"} 1\n"));
  now = at("2026-11-22T02:00:00Z");
  EXPECT_THAT(live.metrics(), testing::Not(testing::HasSubstr("lampglow_visibility_meters{")));
  EXPECT_THAT(live.metrics(),
              testing::HasSubstr("lampglow_last_observation_timestamp_seconds{camera=\"quay\"} "));
}

}  // namespace
}  // namespace lampglow::web
