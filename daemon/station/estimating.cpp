#include "daemon/station/estimating.h"

#include <vector>

#include "daemon/sources/archive.h"
#include "daemon/station/log.h"

namespace lampglow::daemon {

using std::chrono::steady_clock;

namespace {

constexpr std::chrono::seconds kLongestEstimate{120};  // longer than this a worker counts as stuck

std::vector<Bracket> clear_brackets(const CameraConfig& camera) {
  std::vector<Bracket> clear;
  if (camera.reference_archive.empty()) return clear;
  for (const ArchiveBracket& entry : read_frames_csv(camera.reference_archive))
    if (entry.role == FrameRole::clear_reference)
      clear.push_back(load_bracket(camera.reference_archive, entry, camera.site.camera));
  return clear;
}

FrameResult estimate_safely(const Bracket& bracket, const CameraSetup& setup) {
  try {
    FrameResult result = estimate(bracket, setup.site, setup.reference, setup.estimator);
    if (!result.observation.extinction_per_m && !bracket.fault.empty()) result.reason = bracket.fault;
    return result;
  } catch (const std::exception& error) {
    log(LogLevel::error, "the estimator failed", {{"camera", setup.name}, {"reason", error.what()}});
    FrameResult failed;
    failed.observation.time_utc = bracket.time_utc;
    failed.observation.quality = bracket.quality;
    failed.observation.quality.set(Quality::internal_error);
    failed.reason = std::string("the estimator failed: ") + error.what();
    return failed;
  }
}

}  // namespace

WorkWatch::Running::Running(WorkWatch& watch) : watch_(watch) {
  const std::scoped_lock lock(watch_.mutex_);
  mine_ = watch_.since_.insert(steady_clock::now());
}

WorkWatch::Running::~Running() {
  const std::scoped_lock lock(watch_.mutex_);
  watch_.since_.erase(mine_);
}

bool WorkWatch::stuck(steady_clock::time_point now) const {
  const std::scoped_lock lock(mutex_);
  return !since_.empty() && now - *since_.begin() > kLongestEstimate;
}

std::shared_ptr<const CameraSetup> set_up(const CameraConfig& camera) {
  auto setup = std::make_shared<CameraSetup>();
  setup->name = camera.name;
  setup->site = camera.site;
  const std::vector<Bracket> clear = clear_brackets(camera);
  setup->base = setup->reference = learn_reference(clear, setup->site, setup->estimator);
  learn_targets(clear, setup->site, setup->estimator);
  setup->relearn = camera.relearn;
  if (!setup->reference)
    log(LogLevel::warning, "no clear reference: frames will say no_reference", {{"camera", camera.name}});
  return setup;
}

Done estimate_job(const Job& job, int jpeg_quality) {
  const auto begin = steady_clock::now();
  Done done{job.setup, estimate_safely(job.bracket, *job.setup), {}, 0};
  done.duration_s = std::chrono::duration<double>(steady_clock::now() - begin).count();
  done.pictures = render_pictures(job.bracket, job.setup->site, done.result, jpeg_quality);
  return done;
}

}  // namespace lampglow::daemon
