#include "daemon/station/estimating.h"

#include "daemon/sources/archive.h"
#include "daemon/sources/fault.h"
#include "daemon/station/log.h"
#include "daemon/station/notify.h"
#include "daemon/station/stop_while_busy.h"

namespace lampglow::daemon {

using std::chrono::steady_clock;

namespace {

ClearBrackets clear_brackets(const CameraConfig& camera) {
  const auto& archive = camera.reference_archive;
  if (archive.empty()) return {};
  return clear_brackets(archive, read_frames_csv(archive), camera.site.camera);
}

FrameResult without_value(const Bracket& bracket, Quality why, std::string reason) {
  FrameResult result;
  result.observation.time_utc = bracket.time_utc;
  result.observation.quality = bracket.quality;
  result.observation.quality.set(why);
  result.reason = std::move(reason);
  return result;
}

// What is measured with these options is given up soon after `stop` asked for it.
EstimatorOptions until(const std::stop_token& stop, EstimatorOptions options) {
  options.night.fit.given_up = [stop] { return stop.stop_requested(); };
  return options;
}

// The same for what is learned. It asks after each step, and may take longer than systemd waits for a sign of
// life.
EstimatorOptions learning_until(const std::stop_token& stop, EstimatorOptions options) {
  options.night.fit.given_up = [stop] {
    notify_progress();
    return stop.stop_requested();
  };
  return options;
}

FrameResult estimate_safely(const Bracket& bracket, const CameraSetup& setup,
                            const std::stop_token& give_up) {
  try {
    FrameResult result = estimate(bracket, setup.site, setup.reference, until(give_up, setup.estimator));
    if (!result.observation.extinction_per_m && !bracket.fault.empty()) result.reason = bracket.fault;
    return result;
  } catch (const inference::FitStopped&) {
    return without_value(bracket, fault_info(Fault::stopped).quality.value(),
                         "stopped: the station ended before this frame was measured");
  } catch (const std::exception& error) {
    log(LogLevel::error, "the estimator failed", {{"camera", setup.name}, {"reason", error.what()}});
    return without_value(bracket, Quality::internal_error,
                         std::string("the estimator failed: ") + error.what());
  }
}

}  // namespace

std::shared_ptr<const CameraSetup> set_up(const CameraConfig& camera, const std::stop_token& stop) {
  auto setup = std::make_shared<CameraSetup>();
  setup->name = camera.name;
  setup->site = camera.site;
  const ClearBrackets clear = clear_brackets(camera);
  const EstimatorOptions options = learning_until(stop, setup->estimator);
  try {
    setup->base = setup->reference = learn_reference(clear, setup->site, options);
    learn_targets(clear, setup->site, options);
  } catch (const inference::FitStopped&) {
    throw Stopped("learning the clear reference of camera " + camera.name + " was broken off");
  }
  setup->relearn = camera.relearn;
  if (!setup->reference)
    log(LogLevel::warning, "no clear reference: frames will say no_reference", {{"camera", camera.name}});
  return setup;
}

Done estimate_job(const Job& job, int jpeg_quality, const std::stop_token& give_up) {
  const auto begin = steady_clock::now();
  Done done{job.setup, estimate_safely(job.bracket, *job.setup, give_up), {}, 0};
  done.duration_s = std::chrono::duration<double>(steady_clock::now() - begin).count();
  if (give_up.stop_requested()) return done;
  done.pictures = render_pictures(job.bracket, job.setup->site, done.result, jpeg_quality);
  return done;
}

}  // namespace lampglow::daemon
