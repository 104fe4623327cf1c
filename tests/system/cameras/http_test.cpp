// HTTP snapshots from lighttpd and nginx, with everything that can go wrong on the way.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "daemon/errors.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/open_source.h"
#include "tests/system/cameras/web_servers.h"

namespace lampglow::testing {
namespace {

using namespace daemon;
using namespace std::chrono_literals;
using ::testing::HasSubstr;
using ::testing::Not;

SourceOptions quick(const std::string& url) {
  SourceOptions options;
  options.url = url;
  options.connect_timeout = 1s;
  options.frame_timeout = 3s;
  options.stall_timeout = 500ms;
  return options;
}

struct Tried {
  Fault fault = Fault::none;
  std::string message;
  std::optional<Bracket> bracket;
  std::chrono::duration<double> took{};
};

Tried try_once(FrameSource& source) {
  const auto began = std::chrono::steady_clock::now();
  Tried tried;
  try {
    tried.bracket = source.next({});
  } catch (const SourceError& error) {
    tried.fault = error.fault();
    tried.message = error.what();
  }
  tried.took = std::chrono::steady_clock::now() - began;
  return tried;
}

Tried try_once(const SourceOptions& options) {
  return try_once(*open_source(options));
}

class HttpCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!Lighttpd::available()) GTEST_SKIP() << "lighttpd is not installed";
    server_ = std::make_unique<Lighttpd>(folder_.path());
    show(1);
  }
  void show(int number) { save_picture(folder_ / "www/open/snapshot.jpg", jpeg_of(night(number))); }
  std::string snapshot() const { return server_->url("/open/snapshot.jpg"); }
  std::string through(const BadNetwork& network) const {
    return fmt::format("http://127.0.0.1:{}/open/snapshot.jpg", network.port());
  }
  void expect_good(FrameSource& source) {
    const Tried tried = try_once(source);
    EXPECT_EQ(tried.fault, Fault::none) << tried.message;
  }

  TempFolder folder_;
  std::unique_ptr<Lighttpd> server_;
};

TEST_F(HttpCamera, LosslessPictureArrivesBitForBit) {
  const auto picture = night(7, 320, 240, 12);
  save_picture(folder_ / "www/open/snapshot.png", png_of(picture, 12));
  const Tried tried = try_once(quick(server_->url("/open/snapshot.png")));
  ASSERT_TRUE(tried.bracket) << tried.message;
  EXPECT_EQ(tried.bracket->exposures.at(0).pixels.pixels, picture.pixels);
}

TEST_F(HttpCamera, DigestWithAPasswordFullOfPunctuation) {
  save_picture(folder_ / "www/secret/snapshot.jpg", jpeg_of(night(1)));
  write_file(folder_ / "credentials", "admin:" + kPassword + "\n");
  SourceOptions options = quick(server_->url("/secret/snapshot.jpg"));
  options.credentials_file = (folder_ / "credentials").string();
  EXPECT_EQ(try_once(options).fault, Fault::none) << try_once(options).message;

  write_file(folder_ / "credentials", "admin:wrong" + kPassword + "\n");
  options.stall_timeout = 3s;  // lighttpd lets a wrong password wait
  const Tried refused = try_once(options);
  EXPECT_EQ(refused.fault, Fault::unauthorised);
  EXPECT_THAT(refused.message, Not(HasSubstr(kPassword)));

  options.credentials_file = "";
  EXPECT_EQ(try_once(options).fault, Fault::unauthorised);
  options.credentials_file = (folder_ / "nowhere").string();
  EXPECT_EQ(try_once(options).fault, Fault::no_credentials);
}

TEST_F(HttpCamera, CredentialFromSystemd) {
  save_picture(folder_ / "www/secret/snapshot.jpg", jpeg_of(night(1)));
  write_file(folder_ / "porch", "admin:" + kPassword);
  SourceOptions options = quick(server_->url("/secret/snapshot.jpg"));
  options.credentials_file = "porch";
  unsetenv("CREDENTIALS_DIRECTORY");
  EXPECT_EQ(try_once(options).fault, Fault::no_credentials);
  setenv("CREDENTIALS_DIRECTORY", folder_.path().c_str(), 1);
  EXPECT_EQ(try_once(options).fault, Fault::none);
  unsetenv("CREDENTIALS_DIRECTORY");
}

TEST_F(HttpCamera, PasswordInTheAddressIsRefusedAndNotRepeated) {
  for (const char* url : {"http://admin:geheim@127.0.0.1/a.jpg", "rtsp://admin:geheim@127.0.0.1/a"}) {
    try {
      open_source(quick(url));
      FAIL() << "accepted " << url;
    } catch (const ConfigError& error) {
      EXPECT_THAT(error.what(), Not(HasSubstr("geheim")));
      EXPECT_THAT(error.what(), HasSubstr("credentials_file"));
    }
  }
  const auto source = open_source(quick(server_->url("/open/none.jpg?user=admin&pwd=geheim")));
  EXPECT_THAT(source->name(), Not(HasSubstr("geheim")));
  EXPECT_THAT(try_once(*source).message, Not(HasSubstr("geheim")));
}

TEST_F(HttpCamera, RedirectsAreFollowedButNotForEver) {
  EXPECT_EQ(try_once(quick(server_->url("/moved"))).fault, Fault::none);
  EXPECT_EQ(try_once(quick(server_->url("/loop"))).fault, Fault::redirect_loop);
}

TEST_F(HttpCamera, WrongPathAndWrongContent) {
  EXPECT_EQ(try_once(quick(server_->url("/open/none.jpg"))).fault, Fault::http_error);
  write_file(folder_ / "www/open/page.jpg", "<html>log in</html>");
  EXPECT_EQ(try_once(quick(server_->url("/open/page.jpg"))).fault, Fault::not_an_image);
}

TEST_F(HttpCamera, HalfAGigabyteIsRefusedAtOnce) {
  write_file(folder_ / "www/open/huge.jpg", "x");
  fs::resize_file(folder_ / "www/open/huge.jpg", 500u << 20);
  const long before_kib = resident_kib();
  const Tried tried = try_once(quick(server_->url("/open/huge.jpg")));
  EXPECT_EQ(tried.fault, Fault::too_large);
  EXPECT_LT(tried.took.count(), 1);
  EXPECT_LT(resident_kib() - before_kib, 8'192);
}

TEST_F(HttpCamera, TornPicture) {
  auto bytes = jpeg_of(night(1));
  bytes.resize(bytes.size() / 2);
  save_picture(folder_ / "www/open/snapshot.jpg", bytes);
  const auto source = open_source(quick(snapshot()));
  EXPECT_EQ(try_once(*source).fault, Fault::torn);
  show(2);
  expect_good(*source);
}

TEST_F(HttpCamera, NobodyListensThenTheServerIsBack) {
  const auto source = open_source(quick(snapshot()));
  expect_good(*source);
  server_->kill();
  EXPECT_EQ(try_once(*source).fault, Fault::connection_refused);
  server_->start();
  expect_good(*source);
}

TEST_F(HttpCamera, UnknownName) {
  EXPECT_EQ(try_once(quick("http://camera.invalid/a.jpg")).fault, Fault::name_not_found);
}

struct NetworkFault {
  BadNetwork::Toxics toxics;
  Fault fault;
  double within_s;
};

TEST_F(HttpCamera, EveryNetworkFaultHasItsReasonItsTimeAndItsRecovery) {
  const std::vector<NetworkFault> faults{
      {{.cut_after_bytes = 3'000}, Fault::connection_lost, 0.5},
      {{.cut_after_bytes = 0}, Fault::connection_lost, 0.5},
      {{.stall_after_bytes = 3'000}, Fault::stalled, 1.5},
      {{.delay_ms = 10'000}, Fault::stalled, 1.5},
      {{.bytes_per_s = 5}, Fault::too_slow, 1.5},
      {{.corrupt_every_bytes = 97}, Fault::torn, 0.5},
  };
  BadNetwork network(server_->port());
  const auto source = open_source(quick(through(network)));
  expect_good(*source);
  for (const NetworkFault& fault : faults) {
    network.set(fault.toxics);
    const Tried tried = try_once(*source);
    EXPECT_EQ(to_string(tried.fault), to_string(fault.fault)) << tried.message;
    EXPECT_LT(tried.took.count(), fault.within_s) << to_string(fault.fault);
    network.heal();
    expect_good(*source);  // at the very next try
  }
}

// The proxy itself: it divided by a speed that heal() had set to 0 meanwhile, and the test program died.
TEST_F(HttpCamera, TheBadNetworkMayBeHealedInTheMiddleOfAPicture) {
  BadNetwork network(server_->port());
  const auto source = open_source(quick(through(network)));
  std::jthread changing([&](std::stop_token stop) {
    while (!stop.stop_requested()) {
      network.set({.bytes_per_s = 1'000'000});
      network.heal();
    }
  });
  for (int i = 0; i < 20; ++i) expect_good(*source);
}

TEST_F(HttpCamera, SlowButSteadyIsStoppedByTheTotalTime) {
  BadNetwork network(server_->port());
  network.set({.bytes_per_s = 800});  // in pieces of a byte; the picture has some 20 kB
  SourceOptions options = quick(through(network));
  options.min_bytes_per_s = 100;
  options.frame_timeout = 1500ms;
  const Tried tried = try_once(options);
  EXPECT_EQ(tried.fault, Fault::too_slow) << tried.message;
  EXPECT_NEAR(tried.took.count(), 1.5, 0.3);
}

TEST_F(HttpCamera, StopBreaksOffAtOnce) {
  BadNetwork network(server_->port());
  network.set({.delay_ms = 10'000});
  SourceOptions options = quick(through(network));
  options.stall_timeout = 10s;
  options.frame_timeout = 10s;
  const auto source = open_source(options);
  std::stop_source stop;
  std::jthread stopper([&] {
    std::this_thread::sleep_for(200ms);
    stop.request_stop();
  });
  const auto began = std::chrono::steady_clock::now();
  EXPECT_FALSE(source->next(stop.get_token()));
  EXPECT_LT(std::chrono::steady_clock::now() - began, 500ms);
}

TEST_F(HttpCamera, NoDescriptorIsLostOverAHundredFaults) {
  BadNetwork network(server_->port());
  const auto source = open_source(quick(through(network)));
  expect_good(*source);
  const auto cycle = [&] {
    network.set({.cut_after_bytes = 2'000});
    EXPECT_EQ(try_once(*source).fault, Fault::connection_lost);
    network.heal();
    expect_good(*source);
  };
  cycle();
  std::this_thread::sleep_for(100ms);  // the proxy's side closes, too
  const int before = open_descriptors();
  for (int i = 0; i < 100; ++i) cycle();
  EXPECT_TRUE(eventually(2s, [&] { return open_descriptors() <= before; }))
      << open_descriptors() << " > " << before;
}

class TlsCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!Nginx::available()) GTEST_SKIP() << "nginx is not installed";
  }
  void serve(int from_days, int to_days) {
    server_ = std::make_unique<Nginx>(folder_.path(), from_days, to_days);
    save_picture(folder_ / "www/snapshot.jpg", jpeg_of(night(1)));
    save_picture(folder_ / "www/secret/snapshot.jpg", jpeg_of(night(1)));
  }
  SourceOptions trusting(const std::string& path) {
    SourceOptions options = quick(server_->url(path));
    options.ca_file = server_->ca_file();
    return options;
  }
  TempFolder folder_;
  std::unique_ptr<Nginx> server_;
};

TEST_F(TlsCamera, BasicAuthenticationOverVerifiedTls) {
  serve(-1, 30);
  EXPECT_EQ(try_once(trusting("/snapshot.jpg")).fault, Fault::none)
      << try_once(trusting("/snapshot.jpg")).message;
  SourceOptions options = trusting("/secret/snapshot.jpg");
  EXPECT_EQ(try_once(options).fault, Fault::unauthorised);
  write_file(folder_ / "credentials", "admin:" + kPassword + "\n");
  options.credentials_file = (folder_ / "credentials").string();
  EXPECT_EQ(try_once(options).fault, Fault::none) << try_once(options).message;
}

TEST_F(TlsCamera, UnknownIssuerIsRefused) {
  serve(-1, 30);
  EXPECT_EQ(try_once(quick(server_->url("/snapshot.jpg"))).fault, Fault::tls_untrusted);
}

TEST_F(TlsCamera, ExpiredAndNotYetValid) {
  serve(-30, -1);
  EXPECT_EQ(try_once(trusting("/snapshot.jpg")).fault, Fault::tls_expired)
      << try_once(trusting("/snapshot.jpg")).message;
  serve(2, 30);
  EXPECT_EQ(try_once(trusting("/snapshot.jpg")).fault, Fault::tls_expired);
  serve(-1, 30);  // renewed
  EXPECT_EQ(try_once(trusting("/snapshot.jpg")).fault, Fault::none);
}

TEST_F(TlsCamera, RedirectFromTlsToPlainIsNotFollowed) {
  serve(-1, 30);
  EXPECT_EQ(try_once(trusting("/plain")).fault, Fault::protocol_error);
}

TEST_F(TlsCamera, PlainHttpOnATlsPort) {
  serve(-1, 30);
  std::string url = server_->url("/snapshot.jpg");
  url.erase(4, 1);
  EXPECT_EQ(try_once(quick(url)).fault, Fault::http_error);
}

}  // namespace
}  // namespace lampglow::testing
