// The server over real sockets.
#include "web/server.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/json.hpp>
#include <memory>
#include <thread>
#include <vector>

#include "storage/store.h"
#include "tests/storage/sample.h"
#include "tests/storage/temporary_directory.h"
#include "tests/web/client.h"
#include "web/static_files.h"
#include "web/tokens.h"

namespace lampglow::web {
namespace {

using namespace testing_support;
using testing::HasSubstr;
using testing::Not;

class ServerTest : public testing::Test {
 protected:
  void start(ServerOptions options = {}, const ApiOptions& api = {}) {
    options.port = 0;
    live.set_camera("quay", harbour());
    server = std::make_unique<Server>(options, live, api);
    server->start();
  }
  Answer ask(const std::string& target, const std::string& fields = "") {
    return get(server->port(), target, fields);
  }

  TimePoint now = at("2026-11-22T01:00:40Z");
  LiveOptions live_options{.version = "test", .now = [this] { return now; }};
  LiveState live{live_options};
  std::unique_ptr<Server> server;
};

TEST_F(ServerTest, SaysTheCurrentVisibilityAndHowOldItIs) {
  start();
  EXPECT_EQ(ask("/v1/current").status, 503);
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  const Answer answer = ask("/v1/current");
  ASSERT_EQ(answer.status, 200) << answer.head << answer.body;
  EXPECT_TRUE(answer.has("Content-Type: application/geo+json"));
  EXPECT_TRUE(answer.has("Cache-Control: private, max-age=50"));
  EXPECT_TRUE(answer.has("X-Content-Type-Options: nosniff"));
  const auto feature = boost::json::parse(answer.body).as_object();
  EXPECT_EQ(feature.at("type"), "Feature");
  EXPECT_EQ(feature.at("id"), "quay/2026-11-22T01:00:30Z");
  const auto& properties = feature.at("properties").as_object();
  EXPECT_EQ(properties.at("ageSeconds").as_int64(), 10);
  EXPECT_EQ(properties.at("stale"), false);
  EXPECT_EQ(properties.at("staleAfterSeconds").as_int64(), 300);
  EXPECT_NEAR(properties.at("visibility").at("value").to_number<double>(), 2.995732273553991 / 0.012, 1e-9);
  EXPECT_EQ(properties.at("visibility").at("unitCode"), "wmoUnit:m");
  EXPECT_NE(answer.body.find("\"extinction\":{\"value\":0.012,"), std::string::npos) << answer.body;
  EXPECT_EQ(properties.at("weather"), "fog");
  EXPECT_EQ(properties.at("rawMessage"), "METAR HARBOUR 220100Z AUTO /////KT 0200 FG");
}

TEST_F(ServerTest, AStaleObservationHasNoValues) {
  start();
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  now = at("2026-11-22T01:05:31Z");
  const auto feature = boost::json::parse(ask("/v1/current").body);
  const auto& properties = feature.at("properties");
  EXPECT_EQ(properties.at("stale"), true);
  EXPECT_TRUE(properties.at("visibility").at("value").is_null());
  EXPECT_TRUE(properties.at("extinction").at("value").is_null());
  EXPECT_EQ(properties.at("weather"), "unknown");
  EXPECT_EQ(properties.at("timestamp"), "2026-11-22T01:00:30Z");
  EXPECT_EQ(properties.at("ageSeconds").as_int64(), 301);
}

// The camera died, and then the clock was set back by a day: what was seen last is not of now.
TEST_F(ServerTest, AnObservationFromAheadIsStale) {
  start();
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  now = at("2026-11-21T01:00:40Z");
  const auto ahead = boost::json::parse(ask("/v1/current").body);
  EXPECT_EQ(ahead.at("properties").at("stale"), true);
  EXPECT_TRUE(ahead.at("properties").at("visibility").at("value").is_null());
  EXPECT_THAT(live.metrics(), Not(HasSubstr("lampglow_visibility_meters{")));
  live.publish("quay", foggy(at("2026-11-21T01:00:30Z")));
  EXPECT_EQ(boost::json::parse(ask("/v1/current").body).at("properties").at("stale"), false);
}

TEST_F(ServerTest, AnAnswerMayBeKeptUntilItsOwnCamerasNextPicture) {
  start();
  live.set_camera("mole", harbour());
  for (const char* name : {"quay", "mole"}) live.publish(name, foggy(at("2026-11-22T01:00:30Z")));
  CameraHealth health;
  health.up = true;
  health.next_due_utc = at("2026-11-22T01:00:55Z");
  live.set_health("mole", health);
  EXPECT_TRUE(ask("/v1/current?camera=quay").has("Cache-Control: private, max-age=50"));
  const Answer fresh = ask("/v1/current?camera=mole");
  EXPECT_TRUE(fresh.has("Cache-Control: private, max-age=15")) << fresh.head;

  // A camera that goes down is news, though the observation is the same.
  const size_t tag = fresh.head.find("ETag: ") + 6;
  const std::string known =
      "If-None-Match: " + fresh.head.substr(tag, fresh.head.find("\r\n", tag) - tag) + "\r\n";
  EXPECT_EQ(ask("/v1/current?camera=mole", known).status, 304);
  health.up = false;
  health.fault = "http_error";
  live.set_health("mole", health);
  EXPECT_EQ(ask("/v1/current?camera=mole", known).status, 200);
}

TEST_F(ServerTest, AnUnchangedAnswerIsNotSentAgain) {
  start();
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  EXPECT_TRUE(ask("/v1/current").has("ETag: W/\"quay/2026-11-22T01:00:30Z\""));
  const Answer again = ask("/v1/current", "If-None-Match: W/\"quay/2026-11-22T01:00:30Z\"\r\n");
  EXPECT_EQ(again.status, 304);
  EXPECT_EQ(again.body, "");
}

TEST_F(ServerTest, ErrorsAreProblemDetails) {
  start();
  for (const auto& [target, status] : std::map<std::string, int>{{"/v1/current?camera=attic", 404},
                                                                 {"/v1/nothing", 404},
                                                                 {"/v1/current?colour=red", 400},
                                                                 {"/v1/current?camera=%zz", 400},
                                                                 {"/v1/../etc/passwd", 400}}) {
    const Answer answer = ask(target);
    EXPECT_EQ(answer.status, status) << target;
    EXPECT_TRUE(answer.has("Content-Type: application/problem+json")) << target;
    EXPECT_EQ(boost::json::parse(answer.body).at("status").as_int64(), status);
  }
  EXPECT_THAT(ask("/v1/current?colour=red").body,
              HasSubstr("unknown query parameter colour; known here: camera"));
}

TEST_F(ServerTest, NothingWritesThroughHttp) {
  start();
  for (const char* method : {"POST", "PUT", "DELETE", "PATCH"}) {
    Client client(server->port());
    client.send(std::string(method) +
                " /v1/current HTTP/1.1\r\nHost: t\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
    EXPECT_EQ(to_answer(client.read_all()).status, 405) << method;
  }
}

TEST_F(ServerTest, HeadHasTheHeadersAlone) {
  start();
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  Client client(server->port());
  client.send("HEAD /v1/current HTTP/1.1\r\nHost: t\r\nConnection: close\r\n\r\n");
  const Answer answer = to_answer(client.read_all());
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.body, "");
  EXPECT_TRUE(answer.has("Content-Length: "));
}

TEST_F(ServerTest, LimitsHeadersBodiesAndGarbage) {
  start();
  EXPECT_EQ(ask("/healthz", "X: " + std::string(9000, 'x') + "\r\n").status, 431);
  Client body(server->port());
  body.send("POST /healthz HTTP/1.1\r\nHost: t\r\nContent-Length: 5000\r\n\r\n" + std::string(5000, 'x'));
  EXPECT_EQ(to_answer(body.read_all()).status, 413);
  Client garbage(server->port());
  garbage.send("\x16\x03\x01 garbage that is no request\r\n\r\n");
  EXPECT_EQ(to_answer(garbage.read_all()).status, 400);
}

TEST_F(ServerTest, ASlowClientIsDropped) {
  ServerOptions options;
  options.header_timeout = std::chrono::seconds(1);
  start(options);
  Client client(server->port());
  client.send("GET /healthz HTT");
  EXPECT_TRUE(client.closed());
}

TEST_F(ServerTest, ALongAnswerComesWhole) {
  start();
  const std::string_view file = static_file("/dygraph.min.js")->content;
  ASSERT_GT(file.size(), 65536);  // more than one piece
  EXPECT_TRUE(ask("/dygraph.min.js").body == file);
}

TEST_F(ServerTest, AnAddressHasOnlySoManyConnections) {
  ServerOptions options;
  options.max_connections_per_address = 2;
  start(options);
  Client first(server->port()), second(server->port());
  first.send("GET /healthz HTTP/1.1\r\nHost: t\r\n\r\n");
  EXPECT_THAT(first.read_until("}"), HasSubstr("200 OK"));
  second.send("GET /healthz HTTP/1.1\r\nHost: t\r\n\r\n");
  EXPECT_THAT(second.read_until("}"), HasSubstr("200 OK"));
  Client third(server->port());
  EXPECT_TRUE(third.closed());
}

TEST_F(ServerTest, KeepsTheConnectionForManyRequests) {
  start();
  Client client(server->port());
  std::string all;
  for (int i = 0; i < 3; ++i) client.send("GET /healthz HTTP/1.1\r\nHost: t\r\n\r\n");
  client.send("GET /readyz HTTP/1.1\r\nHost: t\r\nConnection: close\r\n\r\n");
  all = client.read_all();
  size_t count = 0;
  for (size_t at = all.find("200 OK"); at != std::string::npos; at = all.find("200 OK", at + 1)) ++count;
  EXPECT_EQ(count, 3u);
  EXPECT_THAT(all, HasSubstr("503 Service Unavailable"));
}

TEST_F(ServerTest, TheStreamSendsWhatComesAndResumes) {
  start();
  Client client(server->port());
  client.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\n\r\n");
  client.read_until("retry: 3000");
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  const std::string first = client.read_until("\"ageSeconds\"");
  EXPECT_THAT(first, HasSubstr("Content-Type: text/event-stream"));
  EXPECT_THAT(
      first,
      HasSubstr("event: observation\ndata: {\"type\":\"Feature\",\"id\":\"quay/2026-11-22T01:00:30Z\""));
  const std::string id =
      live.run_id() + "-1-" + std::to_string(at("2026-11-22T01:00:30Z").time_since_epoch().count());
  EXPECT_THAT(first, HasSubstr("id: " + id));

  live.publish("quay", foggy(at("2026-11-22T01:01:30Z")));
  Client back(server->port());
  back.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\nLast-Event-ID: " + id + "\r\n\r\n");
  const std::string missed = back.read_until("\"ageSeconds\"");
  EXPECT_THAT(missed, HasSubstr("quay/2026-11-22T01:01:30Z"));
  EXPECT_THAT(missed, Not(HasSubstr("quay/2026-11-22T01:00:30Z\"")));
}

// Also what another camera saw at the very time of the last message; some minutes overlap.
TEST_F(ServerTest, AClientOfAnEarlierRunGetsWhatItMissedFromTheDatabase) {
  TemporaryDirectory directory;
  storage::Store store(directory / "x.db");
  for (const char* name : {"quay", "pier"}) {
    const auto camera = store.upsert_camera(name, harbour());
    for (const char* time :
         {"2026-11-22T00:40:30Z", "2026-11-22T00:58:30Z", "2026-11-22T00:59:30Z", "2026-11-22T01:00:30Z"})
      store.put(camera, foggy(at(time)));
  }
  store.commit();
  ApiOptions api;
  api.database = directory / "x.db";
  start({}, api);
  live.set_camera("pier", harbour());
  Client client(server->port());
  client.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\nLast-Event-ID: 17-5-" +
              std::to_string(at("2026-11-22T00:58:30Z").time_since_epoch().count()) + "\r\n\r\n");
  const std::string missed = client.read_until("pier/2026-11-22T01:00:30Z");
  for (const char* row :
       {"quay/2026-11-22T00:59:30Z", "quay/2026-11-22T01:00:30Z", "pier/2026-11-22T00:58:30Z",
        "pier/2026-11-22T00:59:30Z", "pier/2026-11-22T01:00:30Z"})
    EXPECT_THAT(missed, HasSubstr(row));
  EXPECT_THAT(missed, Not(HasSubstr("2026-11-22T00:40:30Z")));
  EXPECT_THAT(missed, Not(HasSubstr("ageSeconds")));
}

// Clients that ask for megabytes and do not read them hold no more than so much memory, and nobody up.
TEST_F(ServerTest, LargeAnswersTogetherAreBounded) {
  TemporaryDirectory directory;
  storage::Store store(directory / "x.db");
  const auto camera = store.upsert_camera("quay", harbour());
  for (int i = 0; i < 6000; ++i)
    store.put(camera, foggy(at("2026-11-17T00:00:00Z") + std::chrono::minutes(i)));
  store.commit();
  ApiOptions api;
  api.database = directory / "x.db";
  ServerOptions options;
  options.max_large_answers_bytes = 20'000'000;
  start(options, api);
  const std::string large =
      "GET "
      "/v1/"
      "observations?from=2026-11-17T00:00:00Z&to=2026-11-22T00:00:00Z&limit=6000&format=geojson "
      "HTTP/1.1\r\nHost: t\r\n\r\n";
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 8; ++i) {
    clients.push_back(std::make_unique<Client>(server->port(), 4096));
    clients.back()->send(large);
  }
  int sent = 0, refused = 0;
  for (const auto& client : clients) {
    const std::string head = client->read_until("\r\n\r\n");
    sent += head.starts_with("HTTP/1.1 200");
    refused += head.starts_with("HTTP/1.1 503") && head.find("Retry-After: 10") != std::string::npos;
  }
  EXPECT_GE(sent, 2);
  EXPECT_GE(refused, 1);
  EXPECT_EQ(sent + refused, 8);
  EXPECT_EQ(ask("/v1/observations?limit=5").status, 200) << "a small one";
  clients.clear();
  bool given_back = false;
  for (int tries = 0; tries < 100 && !given_back;
       ++tries) {  // the server hears of each closed connection by itself
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    Client after(server->port());
    after.send(large);
    given_back = after.read_until("\r\n\r\n").starts_with("HTTP/1.1 200");
  }
  EXPECT_TRUE(given_back);
}

TEST_F(ServerTest, ARequestNamesOneHost) {
  start();
  for (const char* hosts : {"", "Host: a\r\nHost: b\r\n"}) {
    Client client(server->port());
    client.send(std::string("GET /healthz HTTP/1.1\r\n") + hosts + "\r\n");
    EXPECT_THAT(client.read_all(), HasSubstr("HTTP/1.1 400")) << hosts;
  }
  Client old(server->port());
  old.send("GET /healthz HTTP/1.0\r\n\r\n");
  EXPECT_THAT(old.read_all(), HasSubstr("200 OK"));
}

TEST_F(ServerTest, WhatIsNotUtf8IsRefusedInUtf8) {
  start();
  for (const char* target : {"/%ff", "/v1/current?%ff=1", "/v1/current?camera=%c0%80"}) {
    const Answer answer = ask(target);
    EXPECT_EQ(answer.status, 400) << target;
    EXPECT_NO_THROW(boost::json::parse(answer.body)) << target;
  }
  EXPECT_EQ(ask("/v1/current?camera=%C3%A9").status, 404);
}

TEST_F(ServerTest, NoCacheMayKeepAnAnswerBeyondTheTimeThatItHolds) {
  start();
  CameraHealth health;
  health.up = true;
  health.next_due_utc = at("2026-11-22T02:00:30Z");
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  live.set_health("quay", health);
  const Answer answer = ask("/v1/current");
  EXPECT_TRUE(answer.has("Cache-Control: private, max-age=290")) << answer.head;
  EXPECT_TRUE(answer.has("Date: ")) << answer.head;
}

// A message that is sent late says how old it is by then; one that is stale by then is of the past.
TEST_F(ServerTest, TheStreamDoesNotCallOldFramesCurrent) {
  start();
  live.publish("quay", foggy(at("2026-11-22T01:00:30Z")));
  const auto resumed = [&] {
    Client client(server->port());
    client.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\nLast-Event-ID: " + live.run_id() + "-0-0\r\n\r\n");
    return client.read_until("\"reason\"");
  };
  now = at("2026-11-22T01:04:30Z");
  EXPECT_THAT(resumed(), HasSubstr("\"ageSeconds\":240}"));
  now = at("2026-11-22T01:10:30Z");
  EXPECT_THAT(resumed(), Not(HasSubstr("ageSeconds")));
  live.publish("quay", foggy(at("2026-11-22T01:02:30Z")));  // an archive's
  Client client(server->port());
  client.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\nLast-Event-ID: " + live.run_id() + "-1-0\r\n\r\n");
  EXPECT_THAT(client.read_until("\"reason\""), Not(HasSubstr("\"stale\":false")));
}

TEST_F(ServerTest, ATokenThatIsTakenBackEndsItsStreamAndIsRefused) {
  const std::string old_token = new_token(), fresh_token = new_token();
  const auto stream_with = [](const std::string& token) {
    return "GET /v1/stream HTTP/1.1\r\nHost: t\r\nAuthorization: Bearer " + token + "\r\n\r\n";
  };
  ApiOptions api;
  api.access = {Protect::everything, {token_hash(old_token)}};
  start({}, api);
  Client streaming(server->port());
  streaming.send(stream_with(old_token));
  EXPECT_THAT(streaming.read_until("retry"), HasSubstr("200 OK"));
  server->set_access({Protect::everything, {token_hash(fresh_token)}});
  streaming.read_all();  // ends within the client's patience of 10 s
  EXPECT_TRUE(streaming.ended());
  EXPECT_EQ(ask("/v1/cameras", "Authorization: Bearer " + old_token + "\r\n").status, 401);
  EXPECT_EQ(ask("/v1/cameras", "Authorization: Bearer " + fresh_token + "\r\n").status, 200);
  Client again(server->port());
  again.send(stream_with(fresh_token));
  EXPECT_THAT(again.read_until("retry"), HasSubstr("200 OK"));
  server->set_access({});
  EXPECT_EQ(ask("/v1/cameras").status, 200);
}

TEST_F(ServerTest, StopsAtOnceWithClientsConnected) {
  start();
  Client streaming(server->port()), idle(server->port());
  streaming.send("GET /v1/stream HTTP/1.1\r\nHost: t\r\n\r\n");
  streaming.read_until("retry");
  const auto begin = std::chrono::steady_clock::now();
  server.reset();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(1));
}

TEST_F(ServerTest, AnAddressThatIsTakenIsAClearError) {
  start();
  ServerOptions options;
  options.port = server->port();
  try {
    Server second(options, live, {});
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("cannot listen on 127.0.0.1 port " + std::to_string(options.port)));
  }
}

}  // namespace
}  // namespace lampglow::web
