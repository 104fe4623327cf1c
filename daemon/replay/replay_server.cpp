#include "daemon/replay/replay_server.h"

#include <chrono>
#include <utility>

#include "daemon/annotate.h"
#include "daemon/errors.h"
#include "daemon/sources/archive.h"
#include "web/live_state.h"
#include "web/server.h"

namespace lampglow::daemon {
namespace {

// An archive is old by nature: its last frame stays current.
web::LiveOptions live_options(const ReplayServerOptions& options) {
  web::LiveOptions live;
  live.stale_after = std::chrono::years(1000);
  live.version = options.version;
  return live;
}

web::ServerOptions server_options(const ReplayServerOptions& options) {
  web::ServerOptions server;
  server.port = options.port;
  return server;
}

web::ApiOptions api_options(const ReplayServerOptions& options) {
  web::ApiOptions api;
  api.database = options.database;
  return api;
}

std::shared_ptr<const std::string> as_text(const std::vector<std::uint8_t>& bytes) {
  return std::make_shared<const std::string>(bytes.begin(), bytes.end());
}

}  // namespace

struct ReplayServer::Impl {
  explicit Impl(const ReplayServerOptions& options)
      : live(live_options(options)), server(server_options(options), live, api_options(options)) {}

  web::LiveState live;
  web::Server server;
  std::string camera;
  FrameResult last;
};

ReplayServer::ReplayServer(const ReplayServerOptions& options) {
  try {
    impl_ = std::make_unique<Impl>(options);
    impl_->server.start();
  } catch (const std::runtime_error& error) {
    throw IoError(error.what());
  }
}

ReplayServer::~ReplayServer() = default;

std::uint16_t ReplayServer::port() const {
  return impl_->server.port();
}

void ReplayServer::set_site(const Site& site) {
  impl_->camera = site.name;
  impl_->live.set_camera(site.name, site);
  web::CameraHealth health;
  health.up = true;  // an archive does not fail
  impl_->live.set_health(site.name, health);
}

void ReplayServer::publish(const FrameResult& result) {
  impl_->live.publish(impl_->camera, result);
  impl_->last = result;
}

void ReplayServer::show_last_picture(const ReplayOptions& options, const ReplayResult& result) {
  if (result.records.empty()) return;
  const ArchiveSource source(options.archive, result.site.camera);
  const Bracket bracket =
      load_bracket(options.archive, source.brackets().at(result.records.size() - 1), result.site.camera);
  const Exposure* exposure = exposure_to_show(bracket, result.site.camera);
  if (!exposure) return;
  web::Picture picture;
  picture.time_utc = bracket.time_utc;
  picture.plain_jpeg = as_text(plain_jpeg(exposure->pixels, result.site.camera));
  picture.annotated_jpeg =
      as_text(annotated_jpeg(exposure->pixels, result.site.camera, impl_->last.lamps, result.site.targets));
  impl_->live.set_picture(impl_->camera, std::move(picture));
}

}  // namespace lampglow::daemon
