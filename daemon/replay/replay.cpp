#include "daemon/replay/replay.h"

#include <algorithm>
#include <memory>
#include <thread>

#include "daemon/config/pending_file.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/replay/ordered_pool.h"
#include "daemon/sources/archive.h"
#include "estimator/inference/sequence.h"
#include "estimator/observation_csv.h"
#include "storage/store.h"

namespace lampglow::daemon {
namespace {

void check_is_archive(const std::filesystem::path& archive) {
  if (!std::filesystem::is_directory(archive))
    throw DataError(archive.string() +
                    ": expected an archive, a folder with site.toml, frames.csv and images/");
  for (const char* part : {"frames.csv"})
    if (!std::filesystem::exists(archive / part))
      throw DataError((archive / part).string() + ": an archive needs this file, it is not there");
}

Site read_site(const ReplayOptions& options) {
  if (options.site_file) return read_site_file(*options.site_file);
  if (!std::filesystem::exists(options.archive / "site.toml"))
    throw DataError((options.archive / "site.toml").string() +
                    ": an archive needs this file, it is not there");
  return read_site_file(options.archive / "site.toml");
}

std::vector<Bracket> load_clear_brackets(const ArchiveSource& source, const ReplayOptions& options,
                                         const Site& site, const std::stop_token& stop) {
  std::vector<Bracket> clear;
  for (const ArchiveBracket& entry : source.brackets())
    if (entry.role == FrameRole::clear_reference && !stop.stop_requested())
      clear.push_back(load_bracket(options.archive, entry, site.camera));
  return clear;
}

// Every file that the run writes, fed in the order of the frames.
class Writer {
 public:
  Writer(const ReplayOptions& options, const Site& site) {
    if (options.csv) {
      csv_ = std::make_unique<PendingFile>(*options.csv);
      csv_->write(std::string(kObservationCsvHeader) + "\n");
    }
    if (options.database) {
      store_ = std::make_unique<storage::Store>(*options.database);
      camera_ = store_->upsert_camera(site.name, site);
    }
  }

  void put(const FrameResult& result) {
    if (csv_) csv_->write(format_observation_csv(result.observation) + "\n");
    if (store_) store_->put(camera_, result);
  }

  void finish() {
    if (store_) {
      store_->commit();
      store_->checkpoint();
    }
    if (csv_) csv_->publish();
  }

 private:
  std::unique_ptr<PendingFile> csv_;
  std::unique_ptr<storage::Store> store_;
  storage::CameraNumber camera_ = 0;
};

struct Estimated {
  FrameResult result;
  std::string fault;
  FrameRole role;
};

Estimated estimate_frame(const Bracket& bracket, const ReplayResult& run, const EstimatorOptions& options) {
  try {
    return {estimate(bracket, run.site, run.reference, options), bracket.fault, bracket.role};
  } catch (const std::exception& error) {
    FrameResult failed;
    failed.observation.time_utc = bracket.time_utc;
    failed.observation.quality = bracket.quality;
    failed.observation.quality.set(Quality::internal_error);
    failed.reason = std::string("the estimator failed: ") + error.what();
    return {failed, bracket.fault.empty() ? failed.reason : bracket.fault, bracket.role};
  }
}

std::size_t worker_count(const ReplayOptions& options) {
  if (options.workers != 0) return options.workers;
  return std::max(1U, std::thread::hardware_concurrency());
}

}  // namespace

ReplayResult run_replay(const ReplayOptions& options, std::stop_token stop, const ReplayListener& listener) {
  check_is_archive(options.archive);
  ReplayResult run;
  run.site = read_site(options);
  if (listener.site) listener.site(run.site);
  ArchiveSource source(options.archive, run.site.camera);
  run.frames = source.brackets().size();
  const std::vector<Bracket> clear = load_clear_brackets(source, options, run.site, stop);
  run.reference = learn_reference(clear, run.site, options.estimator);
  if (!clear.empty() && !run.reference)
    run.warnings.push_back("no clear reference could be learned: no lamp of the site file shows in the " +
                           std::to_string(clear.size()) + " clear_reference brackets");

  Writer writer(options, run.site);
  inference::Sequence sequence;  // hysteresis, trends and the past hour need the order of time
  OrderedPool<Bracket, Estimated> pool(
      [&](const std::stop_token& stopped) { return source.next(stopped); },
      [&](Bracket&& bracket) { return estimate_frame(bracket, run, options.estimator); },
      [&](Estimated&& frame) {
        if (frame.role == FrameRole::observation)
          frame.result.observation = sequence.add(std::move(frame.result.observation));
        writer.put(frame.result);
        const TimePoint time = frame.result.observation.time_utc;
        if (!frame.fault.empty()) run.warnings.push_back(format_time_utc(time) + ": " + frame.fault);
        run.records.push_back({frame.result.observation, frame.result.reason, frame.fault, frame.role});
        if (listener.result) listener.result(frame.result);
        if (listener.progress) listener.progress(run.records.back(), run.records.size(), run.frames);
      },
      {worker_count(options), 0});
  pool.run(stop);
  writer.finish();
  run.stopped = run.records.size() < run.frames;
  return run;
}

std::vector<Observation> scored_observations(const ReplayResult& result) {
  std::vector<Observation> observations;
  for (const ReplayRecord& record : result.records)
    if (record.role == FrameRole::observation) observations.push_back(record.observation);
  return observations;
}

}  // namespace lampglow::daemon
