#include "daemon/station/feed.h"

#include <mutex>
#include <thread>

#include "daemon/sources/archive.h"

namespace lampglow::daemon {
namespace {

class LiveFeed : public Feed {
 public:
  LiveFeed(const CameraConfig& config, Clock& clock, const FeedCallbacks& callbacks)
      : loop_(options_of(config), open_source(config.source), clock,
              {[callbacks](SlotReport report) { callbacks.on_bracket(std::move(report.bracket)); },
               callbacks.on_event}) {}

  void start() override { loop_.start(); }
  void request_stop() override { loop_.request_stop(); }
  void join() override { loop_.join(); }
  void note_mor(std::optional<double> mor_m) override { loop_.note_mor(mor_m); }

  web::CameraHealth health() const override {
    const CameraStatus status = loop_.status();
    web::CameraHealth health;
    health.up = status.up;
    if (status.fault != Fault::none) health.fault = std::string(to_string(status.fault));
    health.message = status.message;
    health.last_frame_utc = status.last_frame_utc;
    health.next_due_utc = status.next_due_utc;
    for (const auto& [fault, count] : status.tries) health.tries[std::string(to_string(fault))] = count;
    return health;
  }

  bool stuck(MonotonicTime now) const override {
    return now > loop_.status().busy_until + std::chrono::seconds(30);
  }

 private:
  static CameraLoopOptions options_of(const CameraConfig& config) {
    CameraLoopOptions options;
    options.id = config.name;
    options.schedule = config.schedule;
    const Site& site = config.site;
    if (site.latitude_deg && site.longitude_deg)
      options.place = Place{*site.latitude_deg, *site.longitude_deg};
    options.checks = {site.camera.width_px, site.camera.height_px, site.camera.bit_depth, 3};
    if (config.adapt_exposure && !config.source.bracket.empty()) {
      AdaptOptions adapt;
      adapt.black_level_dn = site.camera.black_level_dn;
      adapt.saturation_dn = site.camera.saturation_dn;
      options.adapt = adapt;
    }
    options.seed = std::hash<std::string>{}(config.name);
    return options;
  }

  CameraLoop loop_;
};

class ArchiveFeed : public Feed {
 public:
  ArchiveFeed(const CameraConfig& config, FeedCallbacks callbacks)
      : source_(config.source.url.substr(8), config.site.camera), callbacks_(std::move(callbacks)) {}
  ~ArchiveFeed() override { join(); }

  void start() override {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }
  void request_stop() override { thread_.request_stop(); }
  void join() override {
    if (thread_.joinable()) {
      thread_.request_stop();
      thread_.join();
    }
  }
  web::CameraHealth health() const override {
    const std::scoped_lock lock(mutex_);
    return health_;
  }
  void note_mor(std::optional<double>) override {}
  bool stuck(MonotonicTime) const override { return false; }

 private:
  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      std::optional<Bracket> bracket = source_.next(stop);
      if (!bracket) break;
      {
        const std::scoped_lock lock(mutex_);
        health_.up = bracket->fault.empty();
        health_.message = bracket->fault;
        health_.last_frame_utc = bracket->time_utc;
      }
      callbacks_.on_bracket(std::move(*bracket));
    }
    const std::scoped_lock lock(mutex_);
    health_.message = "the archive has ended";
  }

  ArchiveSource source_;
  FeedCallbacks callbacks_;
  mutable std::mutex mutex_;
  web::CameraHealth health_;
  std::jthread thread_;
};

}  // namespace

std::unique_ptr<Feed> make_feed(const CameraConfig& config, Clock& clock, FeedCallbacks callbacks) {
  if (config.source.url.starts_with("archive:"))
    return std::make_unique<ArchiveFeed>(config, std::move(callbacks));
  return std::make_unique<LiveFeed>(config, clock, std::move(callbacks));
}

}  // namespace lampglow::daemon
