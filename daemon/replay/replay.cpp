#include "daemon/replay/replay.h"

#include <algorithm>
#include <memory>
#include <thread>
#include <utility>

#include "daemon/config/pending_file.h"
#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/replay/ordered_pool.h"
#include "daemon/replay/reference_log.h"
#include "daemon/sources/archive.h"
#include "estimator/inference/relearner.h"
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

// None any more once the run is to stop.
ClearBrackets clear_brackets_until(const std::stop_token& stop, const ArchiveSource& source,
                                   const ReplayOptions& options, const Site& site) {
  const ClearBrackets clear = clear_brackets(options.archive, source.brackets(), site.camera);
  return {clear.count,
          [clear, stop](std::size_t i) { return stop.stop_requested() ? Bracket{} : clear.load(i); }};
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

  // The reference at the beginning, and as a night left it.
  void put_reference(const storage::ReferenceRecord& record) {
    if (store_) store_->put_reference(camera_, record);
  }
  void put_event(const storage::Event& event) {
    if (store_) store_->put_event(event);
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

Estimated estimate_frame(const Bracket& bracket, const Site& site,
                         const std::optional<ClearReference>& reference, const EstimatorOptions& options) {
  try {
    return {estimate(bracket, site, reference, options), bracket.fault, bracket.role};
  } catch (const std::exception& error) {
    FrameResult failed;
    failed.observation.time_utc = bracket.time_utc;
    failed.observation.quality = bracket.quality;
    failed.observation.quality.set(Quality::internal_error);
    failed.reason = std::string("the estimator failed: ") + error.what();
    return {failed, bracket.fault.empty() ? failed.reason : bracket.fault, bracket.role};
  }
}

// An archive's frames night by night: where relearning is wanted, no frame of a night is handed out before
// what the night before it taught is settled. So the result does not depend on how many frames are under
// work.
class Nights {
 public:
  Nights(ArchiveSource& source, bool apart, std::optional<double> longitude_deg)
      : source_(source), apart_(apart), longitude_deg_(longitude_deg) {}

  // Empty at the end of a night, and of the archive.
  std::optional<Bracket> next(const std::stop_token& stop) {
    if (!held_) held_ = source_.next(stop);
    more_ = held_.has_value();
    if (!held_) return std::nullopt;
    const std::int64_t night = inference::night_number(held_->time_utc, longitude_deg_);
    if (apart_ && night > night_.value_or(night)) return std::nullopt;
    night_ = night;
    return std::exchange(held_, std::nullopt);
  }
  // On to the next night; false if the archive is at its end.
  bool next_night() {
    night_.reset();
    return more_;
  }

 private:
  ArchiveSource& source_;
  const bool apart_;
  const std::optional<double> longitude_deg_;
  std::optional<Bracket> held_;
  std::optional<std::int64_t> night_;
  bool more_ = true;
};

// What the night taught, if anything: on record, and in force from now on.
void settle(inference::Relearner& relearner, ReplayResult& run, Writer& writer) {
  const auto settled = relearner.settle();
  if (!settled || !settled->learned()) return;
  const ClearReference& reference = relearner.reference();
  run.relearned.push_back({*settled, reference});
  writer.put_reference(reference_record(reference, *settled));
  writer.put_event({0, settled->valid_from, storage::EventKind::reference_learned, storage::Severity::info,
                    run.site.name, lesson_text(reference, *settled)});
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
  const ClearBrackets clear = clear_brackets_until(stop, source, options, run.site);
  run.reference = learn_reference(clear, run.site, options.estimator);
  learn_targets(clear, run.site, options.estimator);
  if (clear.count > 0 && !run.reference)
    run.warnings.push_back("no clear reference could be learned: no lamp of the site file shows in the " +
                           std::to_string(clear.count) + " clear_reference brackets");

  Writer writer(options, run.site);
  std::optional<inference::Relearner> relearner;
  if (options.relearn && run.reference) {
    relearner.emplace(*run.reference, *options.relearn, run.site.longitude_deg);
    writer.put_reference(reference_record(*run.reference, run.reference->learned_utc));
  }
  inference::Sequence sequence;  // hysteresis, trends and the past hour need the order of time
  const auto take = [&](Estimated&& frame) {
    if (frame.role == FrameRole::observation) {
      frame.result.observation = sequence.add(frame.result.observation);
      if (relearner) relearner->add(frame.result);
    }
    writer.put(frame.result);
    const TimePoint time = frame.result.observation.time_utc;
    if (!frame.fault.empty()) run.warnings.push_back(format_time_utc(time) + ": " + frame.fault);
    run.records.push_back({frame.result.observation, frame.result.reason, frame.fault, frame.role});
    if (listener.result) listener.result(frame.result);
    if (listener.progress) listener.progress(run.records.back(), run.records.size(), run.frames);
  };
  Nights nights(source, relearner.has_value(), run.site.longitude_deg);
  do {
    const std::optional<ClearReference> reference =
        relearner ? std::optional(relearner->reference()) : run.reference;
    OrderedPool<Bracket, Estimated> pool(
        [&](const std::stop_token& stopped) { return nights.next(stopped); },
        [&](Bracket&& bracket) { return estimate_frame(bracket, run.site, reference, options.estimator); },
        take, {worker_count(options), 0});
    pool.run(stop);
    if (relearner && !stop.stop_requested()) settle(*relearner, run, writer);
  } while (nights.next_night() && !stop.stop_requested());
  writer.finish();
  run.stopped = run.records.size() < run.frames;
  return run;
}

const std::optional<ClearReference>& ReplayResult::reference_at(TimePoint time) const {
  const std::optional<ClearReference>* found = &reference;
  for (const RelearnedReference& later : relearned)
    if (later.settled.valid_from <= time) found = &later.reference;
  return *found;
}

std::vector<Observation> scored_observations(const ReplayResult& result) {
  std::vector<Observation> observations;
  for (const ReplayRecord& record : result.records)
    if (record.role == FrameRole::observation) observations.push_back(record.observation);
  return observations;
}

}  // namespace lampglow::daemon
