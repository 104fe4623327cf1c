// `lampglow serve` as its keeper meets it: a simulated night through an archive and through a web camera,
// asked over HTTP, reloaded, ended, and its database looked into with the program's own commands.
#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>
#include <signal.h>

#include <algorithm>
#include <boost/json.hpp>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <thread>

#include "tests/support/run_program.h"
#include "tests/system/cameras/web_servers.h"
#include "tests/system/station/serving.h"

namespace lampglow::testing {
namespace {

using namespace std::chrono_literals;
using test::ProgramRun;
using test::read_all;
using test::run_program;
using ::testing::HasSubstr;
using ::testing::Not;
namespace json = boost::json;

constexpr int kFrames = 5;
constexpr int kClearReferences = 2;

// One simulated night for all tests, written by the program itself.
class Station : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    night_ = new TempFolder;
    const ProgramRun run = run_program({"simulate", archive().string(), "--style", "webcam", "--seed", "3",
                                        "--frames", std::to_string(kFrames), "--photons", "50000"});
    ASSERT_EQ(run.exit_code, 0) << run.err;
  }
  static void TearDownTestSuite() { delete night_; }
  static fs::path archive() { return night_->path() / "night"; }

  fs::path config_file() const { return folder_ / "station.toml"; }
  std::string database() const { return (folder_ / "data/lampglow.db").string(); }

  void configure(const std::string& url, const std::string& interval_s = "1", const std::string& port = "") {
    write_file(config_file(), "name = \"quay\"\nsite_file = \"" + (archive() / "site.toml").string() +
                                  "\"\nreference_archive = \"" + archive().string() +
                                  "\"\n\n[source]\nurl = \"" + url +
                                  "\"\n\n[schedule]\ninterval_s = " + interval_s +
                                  "\nwhen = \"both\"\n\n[station]\ndata_directory = \"data\"\n\n" +
                                  "[http]\nport = " + (port.empty() ? std::to_string(port_) : port) + "\n");
  }

  json::value get(const std::string& path) const {
    const Answer answer = ask(port_, path);
    EXPECT_EQ(answer.status, 200) << path << "\n" << answer.body;
    return answer.status == 200 ? json::parse(answer.body) : json::value(json::object());
  }

  json::array observations() const {
    return get("/v1/observations?from=2026-01-01T00:00:00Z&limit=1000").at("observations").as_array();
  }

  // Until the program has answered so many observations.
  bool has_observations(std::size_t count) const {
    return eventually(20s, [&] {
      const Answer answer = ask(port_, "/v1/observations?from=2026-01-01T00:00:00Z&limit=1000");
      return answer.status == 200 && json::parse(answer.body).at("observations").as_array().size() >= count;
    });
  }

  // A frame is stored first and shown a moment later.
  bool camera_is(bool up) const {
    return eventually(15s, [&] {
      const Answer answer = ask(port_, "/v1/current");
      return answer.status == 200 &&
             json::parse(answer.body).at("properties").at("sensor").at("up").as_bool() == up;
    });
  }

  // The times of the rows that `lampglow export` writes.
  std::vector<std::string> exported_times() const {
    const ProgramRun run = run_program({"export", database()});
    EXPECT_EQ(run.exit_code, 0) << run.err;
    std::istringstream lines(run.out);
    std::vector<std::string> times;
    std::string line;
    std::getline(lines, line);
    EXPECT_THAT(line, HasSubstr("time_utc,mor_m,mor_low_m,mor_high_m,limit,extinction_per_m"));
    while (std::getline(lines, line)) times.push_back(line.substr(0, line.find(',')));
    return times;
  }

  void end_well(Serving& station) const {
    station.signal(SIGTERM);
    EXPECT_EQ(station.wait(5s), 0) << station.log();
    std::error_code absent;  // size -1; else it must be empty: written back and cut
    const auto wal_bytes = static_cast<std::intmax_t>(fs::file_size(database() + "-wal", absent));
    EXPECT_LE(wal_bytes, 0) << "the WAL was not written back";
    const ProgramRun check = run_program({"db", "check", database()});
    EXPECT_EQ(check.exit_code, 0) << check.out << check.err;
  }

  static TempFolder* night_;
  TempFolder folder_;
  int port_ = free_port();
};

TempFolder* Station::night_ = nullptr;

TEST_F(Station, AnArchiveIsServedAndStored) {
  configure("archive:" + archive().string());
  EXPECT_EQ(run_program({"check-config", config_file().string()}).exit_code, 0);
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(has_observations(kFrames + kClearReferences)) << station.log();
  ASSERT_TRUE(camera_is(true)) << station.log();
  const std::string all =
      "lampglow_frames_total{camera=\"quay\",result=\"value\"} " + std::to_string(kFrames + kClearReferences);
  EXPECT_TRUE(eventually(3s, [&] { return ask(port_, "/metrics").body.find(all) != std::string::npos; }));

  // Who asks for nothing at all gets the last day, however old the archive is.
  EXPECT_EQ(get("/v1/observations").at("observations").as_array().size(), kFrames + kClearReferences);

  EXPECT_EQ(get("/healthz").at("status").as_string(), "ok");
  const json::value current = get("/v1/current").at("properties");
  EXPECT_EQ(current.at("camera").as_string(), "quay");
  EXPECT_TRUE(current.at("stale").as_bool()) << "a night of January is not the air of today";
  EXPECT_TRUE(current.at("visibility").at("value").is_null());
  EXPECT_EQ(ask(port_, "/v1/frames/latest.jpg").body.substr(0, 2), "\xFF\xD8");
  EXPECT_EQ(ask(port_, "/v1/frames/latest.jpg?annotated=true").body.substr(0, 2), "\xFF\xD8");
  end_well(station);

  std::set<std::string> taken;  // the archive's own times
  std::istringstream rows(read_all(archive() / "frames.csv"));
  std::string row;
  std::getline(rows, row);
  while (std::getline(rows, row)) taken.insert(row.substr(0, row.find(',')));
  const std::vector<std::string> stored = exported_times();
  EXPECT_EQ(std::vector<std::string>(taken.begin(), taken.end()), stored);
}

TEST_F(Station, ItEndsInTimeAmidstAnArchiveAndTakesUpWithoutDoubling) {
  configure("archive:" + archive().string());
  std::size_t first = 0;
  {
    Serving station(config_file(), folder_ / "log");
    ASSERT_TRUE(has_observations(1)) << station.log();
    first = observations().size();
    end_well(station);
  }
  EXPECT_GE(exported_times().size(), first);
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(has_observations(kFrames + kClearReferences)) << station.log();
  end_well(station);
  const std::vector<std::string> times = exported_times();
  EXPECT_EQ(times.size(), std::set<std::string>(times.begin(), times.end()).size());
  EXPECT_EQ(times.size(), kFrames + kClearReferences);
}

// The rows that `lampglow export` writes, by their time, which is taken out of them.
std::map<std::string, json::object> rows_of(const std::string& database) {
  const ProgramRun run = run_program({"export", database, "--format", "json"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  std::map<std::string, json::object> rows;
  const json::value all = json::parse(run.out);
  for (const json::value& one : all.as_array()) {
    json::object row = one.as_object();
    const std::string time(row.at("time_utc").as_string());
    row.erase("time_utc");
    rows[time] = std::move(row);
  }
  return rows;
}

// Some 15 s of work are begun when it is told to end. What is not measured in time is given up and stored as
// that; what has a value is the whole answer.
TEST_F(Station, ItEndsInTimeHoweverMuchItsWorkersHaveInHand) {
  const int workers = 30 * static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  const fs::path slow = folder_ / "slow";
  ASSERT_EQ(run_program({"simulate", slow.string(), "--style", "webcam", "--seed", "3", "--frames", "2",
                         "--lamps", "40", "--photons", "50000"})
                .exit_code,
            0);
  const fs::path whole = folder_ / "whole.db";  // what the pictures give if nobody ends
  lengthen(slow, 2);
  ASSERT_EQ(run_program({"replay", slow.string(), "--db", whole.string()}).exit_code, 0);
  const auto expected = rows_of(whole.string());
  lengthen(slow, workers);

  write_file(config_file(),
             "name = \"quay\"\nsite_file = \"slow/site.toml\"\n[source]\nurl = \"archive:slow\"\n[station]\n"
             "data_directory = \"data\"\nworkers = " +
                 std::to_string(workers) + "\n[http]\nport = " + std::to_string(port_) + "\n");
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(eventually(30s, [&] { return ask(port_, "/readyz").status == 200; })) << station.log();
  std::this_thread::sleep_for(2s);
  end_well(station);
  EXPECT_THAT(station.log(), HasSubstr("too slow to end")) << "nothing was in hand";
  int given_up = 0;
  for (const auto& [time, row] : rows_of(database())) {
    const bool odd = (time[18] - '0') % 2 != 0;
    const bool repeated = time.starts_with("2027");
    if (row == expected.at(!repeated ? time : odd ? "2027-01-01T00:00:01Z" : "2027-01-01T00:00:00Z"))
      continue;
    ++given_up;
    EXPECT_TRUE(row.at("mor_m").is_null()) << time << ": half an answer";
    EXPECT_THAT(json::serialize(row), HasSubstr("stopped: the station ended")) << time;
  }
  EXPECT_GE(given_up, workers / 3) << "what was in hand is stored, too";
}

TEST_F(Station, TlsByOptionForThoseWhoTrustItsCertificateAndSpeakAVersionThatHolds) {
  configure("archive:" + archive().string());
  const fs::path certificate = folder_ / "server.pem", key = folder_ / "server.key";
  write_certificate(certificate, key, -1, 1);
  write_file(config_file(),
             read_all(config_file()) + "tls_certificate = \"server.pem\"\ntls_key = \"server.key\"\n");
  Serving station(config_file(), folder_ / "log");
  Answer answer;
  ASSERT_TRUE(eventually(20s,
                         [&] {
                           answer = ask_securely(port_, "/healthz", certificate);
                           return answer.status == 200;
                         }))
      << answer.failure << station.log();
  EXPECT_THAT(answer.body, HasSubstr("\"status\":\"ok\""));
  // An answer of more than one piece (64 KiB).
  const Answer longer = ask_securely(port_, "/dygraph.min.js", certificate);
  EXPECT_TRUE(longer.body == read_all("/usr/share/javascript/dygraphs/dygraph.min.js")) << longer.failure;

  const fs::path stranger = folder_ / "stranger.pem";
  write_certificate(stranger, folder_ / "stranger.key", -1, 1);
  EXPECT_THAT(ask_securely(port_, "/healthz", stranger).failure, HasSubstr("certificate"));
  EXPECT_THAT(ask_securely(port_, "/healthz", certificate, TlsVersions::up_to_1_1).failure,
              HasSubstr("SSL connect error"));
  EXPECT_EQ(ask(port_, "/healthz").status, 0) << "plain HTTP got an answer";

  // A renewed certificate, written over the old one as certbot and its like do, is taken over by a reload.
  const auto install = [&](const char* name) {
    for (const char* end : {".pem", ".key"})
      fs::copy_file(folder_ / (std::string(name) + end), folder_ / (std::string("server") + end),
                    fs::copy_options::overwrite_existing);
    station.signal(SIGHUP);
  };
  write_certificate(folder_ / "renewed.pem", folder_ / "renewed.key", -1, 90);
  install("renewed");
  EXPECT_TRUE(eventually(10s, [&] {
    return ask_securely(port_, "/healthz", folder_ / "renewed.pem").status == 200;
  })) << station.log();
  EXPECT_THAT(station.log(), Not(HasSubstr("only a restart takes it over")));
  // Half a renewal (no key of this certificate) is refused, and the last good one goes on.
  fs::remove(folder_ / "renewed.key");
  fs::copy_file(folder_ / "stranger.key", folder_ / "renewed.key");
  install("renewed");
  EXPECT_TRUE(eventually(10s, [&] { return station.log().find("server.key") != std::string::npos; }))
      << station.log();
  EXPECT_EQ(ask_securely(port_, "/healthz", folder_ / "renewed.pem").status, 200);
  end_well(station);

  // A key that is not the certificate's is told with its file's name, and nothing is served.
  fs::copy_file(folder_ / "stranger.key", key, fs::copy_options::overwrite_existing);
  Serving wrong(config_file(), folder_ / "log2");
  EXPECT_GT(wrong.wait(20s), 0);
  EXPECT_THAT(wrong.log(), HasSubstr("server.key"));
}

// Beside the new file lies the old one's WAL for some seconds: nothing is read with that.
TEST_F(Station, ABackupThatIsPutBackWhileItRunsIsGoneOnWith) {
  configure("archive:" + archive().string());
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(has_observations(kFrames + kClearReferences)) << station.log();
  const std::string copy = (folder_ / "copy.db").string();
  ASSERT_EQ(run_program({"db", "backup", database(), copy}).exit_code, 0);
  fs::rename(copy, database());
  bool refused = false;
  EXPECT_TRUE(eventually(20s, [&] {
    const int status = ask(port_, "/v1/observations").status;
    refused |= status == 503;
    return refused && status == 200;
  })) << station.log();
  EXPECT_EQ(get("/v1/observations").at("observations").as_array().size(), kFrames + kClearReferences);
  EXPECT_THAT(station.log(), HasSubstr("was replaced"));
  EXPECT_THAT(station.log(), Not(HasSubstr("cannot be written")));
  end_well(station);
  int wal = 0;
  for (const auto& entry : fs::directory_iterator(folder_ / "data"))
    wal += entry.path().filename().string().find(".replaced-") != std::string::npos;
  EXPECT_GE(wal, 1) << "the old WAL is not kept";
}

// quick_check at the start found nothing: the disk spoils a page later.
TEST_F(Station, DamageThatTheNightlyBackupFindsEndsInAFreshDatabase) {
  configure("archive:" + archive().string());
  {
    Serving station(config_file(), folder_ / "log");
    ASSERT_TRUE(has_observations(kFrames + kClearReferences)) << station.log();
    end_well(station);
  }
  fs::create_directory(folder_ / "incoming");
  configure("watch:" + (folder_ / "incoming").string());
  Serving station(config_file(), folder_ / "log2");
  ASSERT_TRUE(eventually(20s, [&] { return ask(port_, "/readyz").status == 200; })) << station.log();
  {  // of the pictures, which nothing reads by itself while there are no new ones
    const int page = SQLite::Database(database())
                         .execAndGet(
                             "SELECT pageno FROM dbstat WHERE name = 'picture' AND pagetype = 'leaf' "
                             "ORDER BY path DESC LIMIT 1")
                         .getInt();
    std::fstream file(database(), std::ios::in | std::ios::out | std::ios::binary);
    file.seekp((page - 1) * std::streamoff{4096});
    file << std::string(4096, '\xff');
  }
  const auto hour =
      std::chrono::floor<std::chrono::hours>(std::chrono::system_clock::now()).time_since_epoch();
  write_file(config_file(), read_all(config_file()) +
                                "[keep]\nbackup_hour_utc = " + std::to_string(hour.count() % 24) + "\n");
  station.signal(SIGHUP);
  const auto events_tell = [&](const char* kind) {
    return eventually(20s, [&] { return ask(port_, "/v1/events").body.find(kind) != std::string::npos; });
  };
  EXPECT_TRUE(events_tell("database_set_aside")) << station.log();
  EXPECT_TRUE(events_tell("backup_failed")) << station.log();
  int aside = 0;
  for (const auto& entry : fs::directory_iterator(folder_ / "data"))
    aside += entry.path().filename().string().starts_with("lampglow.db.corrupt-");
  EXPECT_GE(aside, 1);
  EXPECT_TRUE(!fs::exists(folder_ / "data/backups") || fs::is_empty(folder_ / "data/backups"));
  end_well(station);
}

TEST_F(Station, NoSecretIsInAnyAnswerOrTheLog) {
  const std::string made = run_program({"token"}).out;  // "token: ...\nhash:  ...\n"
  const std::string token = made.substr(7, 43), hash = made.substr(made.find("hash:  ") + 7, 64);
  write_file(folder_ / "account", "admin:geheim-1\n");
  write_file(config_file(),
             "name = \"quay\"\nsite_file = \"" + (archive() / "site.toml").string() +
                 "\"\n[source]\nurl = \"http://127.0.0.1:" + std::to_string(free_port()) +
                 "/user=admin&password=geheim-4/now.jpg?key=geheim-2\"\ncredentials_file = \"" +
                 (folder_ / "account").string() +
                 "\"\n[schedule]\ninterval_s = 1\n[station]\ndata_directory = \"data\"\n[http]\nport = " +
                 std::to_string(port_) + "\nprotect = \"pictures\"\ntoken_hashes = [\"" + hash + "\"]\n");
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(has_observations(2)) << station.log();
  EXPECT_EQ(ask(port_, "/v1/frames/latest.jpg").status, 401);
  std::string told;
  for (const char* path : {"/v1/current", "/v1/cameras", "/v1/observations", "/v1/events", "/v1/lights",
                           "/healthz", "/metrics", "/v1/frames", "/openapi.json", "/"})
    told += ask(port_, path).body;
  EXPECT_THAT(told, HasSubstr("connection_refused"));
  write_file(config_file(), read_all(config_file()) + "no_such_key = \"geheim-3\"\n");
  station.signal(SIGHUP);
  EXPECT_TRUE(eventually(5s, [&] { return station.log().find("no_such_key") != std::string::npos; }))
      << station.log();
  end_well(station);
  told += station.log() + run_program({"export", database()}).out + read_all(database());
  for (const std::string& secret : {std::string("geheim"), token, hash})
    EXPECT_EQ(told.find(secret), std::string::npos) << secret;
}

class StationWithWebCamera : public Station {
 protected:
  void SetUp() override {
    if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
    web_ = std::make_unique<Lighttpd>(folder_ / "camera");
    show(2);
    configure(web_->url("/open/now.jpg"));
  }
  void show(int number) const {
    const std::string bytes = read_all(archive() / ("images/000" + std::to_string(number) + ".jpg"));
    save_picture(folder_ / "camera/www/open/now.jpg", {bytes.begin(), bytes.end()});
  }

  std::unique_ptr<Lighttpd> web_;
};

TEST_F(StationWithWebCamera, ANightIsMeasuredReloadedAndStored) {
  Serving station(config_file(), folder_ / "log");
  for (int number = 2; number < 5; ++number) {
    show(number);
    ASSERT_TRUE(has_observations(static_cast<std::size_t>(number - 1))) << station.log();
  }
  ASSERT_TRUE(camera_is(true)) << station.log();
  const json::value current = get("/v1/current").at("properties");
  EXPECT_FALSE(current.at("stale").as_bool());
  EXPECT_TRUE(current.at("visibility").at("value").is_double());
  EXPECT_TRUE(current.at("sensor").at("up").as_bool());
  EXPECT_GT(current.at("lightsUsed").as_int64(), 0);

  // A new interval is taken over; the port needs a restart and this is said; a broken file changes nothing.
  configure(web_->url("/open/now.jpg"), "2", "1");
  station.signal(SIGHUP);
  EXPECT_TRUE(eventually(5s, [&] { return station.log().find("key=http.port") != std::string::npos; }))
      << station.log();
  const auto refused = [&](std::size_t times) {
    std::size_t count = 0;
    const std::string log = station.log(), text = "the new configuration cannot be used; the old one stays";
    for (auto at = log.find(text); at != std::string::npos; at = log.find(text, at + 1)) ++count;
    return count >= times;
  };
  write_file(config_file(), "interval_s = 1\n");
  station.signal(SIGHUP);
  EXPECT_TRUE(eventually(5s, [&] { return refused(1); })) << station.log();
  // Nor does one whose mistake only shows when its camera is set up, and the camera goes on.
  configure(web_->url("/open/now.jpg"), "3");
  std::string config = read_all(config_file());
  config.replace(config.find(archive().string() + "\"\n\n[source]"), archive().string().size(),
                 "/no/such/archive");
  write_file(config_file(), config);
  station.signal(SIGHUP);
  EXPECT_TRUE(eventually(5s, [&] { return refused(2); })) << station.log();
  const std::size_t before = observations().size();
  EXPECT_TRUE(has_observations(before + 1)) << "it does not go on after the reloads\n" << station.log();

  const json::array seen = observations();
  end_well(station);
  const std::vector<std::string> stored = exported_times();
  for (const json::value& one : seen)
    EXPECT_THAT(stored, ::testing::Contains(std::string(one.at("time_utc").as_string())))
        << "shown, but lost";
  EXPECT_EQ(stored.size(), std::set<std::string>(stored.begin(), stored.end()).size());
}

TEST_F(StationWithWebCamera, ADeadCameraIsToldAndItsReturnToo) {
  Serving station(config_file(), folder_ / "log");
  ASSERT_TRUE(has_observations(1)) << station.log();
  ASSERT_TRUE(camera_is(true)) << station.log();
  fs::remove(folder_ / "camera/www/open/now.jpg");
  ASSERT_TRUE(camera_is(false)) << station.log();
  EXPECT_EQ(get("/v1/current").at("properties").at("sensor").at("fault").as_string(), "http_error");
  EXPECT_THAT(ask(port_, "/metrics").body, HasSubstr("lampglow_camera_up{camera=\"quay\"} 0"));
  EXPECT_TRUE(eventually(2s, [&] {
    return ask(port_, "/healthz").body.find("camera quay: http_error") != std::string::npos;
  })) << ask(port_, "/healthz").body;
  show(3);
  ASSERT_TRUE(camera_is(true)) << station.log();
  EXPECT_THAT(json::serialize(get("/v1/events")), HasSubstr("source_recovered"));
  EXPECT_TRUE(eventually(2s, [&] { return get("/healthz").at("status").as_string() == "ok"; }));
  end_well(station);
}

TEST_F(StationWithWebCamera, ProbeTellsWhatTheCameraIs) {
  const fs::path saved = folder_ / "first-look";
  const ProgramRun run = run_program({"probe", web_->url("/open/now.jpg"), "--output", saved.string()});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("driver    HTTP, server lighttpd"));
  EXPECT_THAT(run.out, HasSubstr("in use    picture 760x504"));
  EXPECT_THAT(run.out, HasSubstr("Lamps are saturated"));
  EXPECT_EQ(run_program({"check-config", (saved / "site.toml").string()}).exit_code, 0);
  const ProgramRun replayed = run_program({"replay", saved.string(), "--csv", (folder_ / "x.csv").string()});
  EXPECT_EQ(replayed.exit_code, 0) << replayed.err;

  const ProgramRun gone = run_program({"probe", web_->url("/open/gone.jpg")});
  EXPECT_EQ(gone.exit_code, 74);
  EXPECT_THAT(gone.err, HasSubstr("HTTP status 404"));
  const ProgramRun there = run_program({"probe", web_->url("/open/now.jpg"), "--output", saved.string()});
  EXPECT_EQ(there.exit_code, 64) << there.err;
}

TEST(ExampleConfiguration, IsValid) {
  const ProgramRun run = run_program({"check-config", LAMPGLOW_SOURCE_DIR "/systemd/lampglow.toml"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("station with 1 cameras, HTTP on 127.0.0.1:8080"));
}

}  // namespace
}  // namespace lampglow::testing
