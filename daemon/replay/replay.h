// An archive through the pipeline: read, estimated by a pool of workers, written in order, scored, reported.
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/replay/scores.h"
#include "estimator/estimate.h"
#include "estimator/inference/relearner.h"

namespace lampglow::daemon {

struct ReplayOptions {
  std::filesystem::path archive;
  std::optional<std::filesystem::path> site_file;  // instead of ARCHIVE/site.toml
  std::optional<std::filesystem::path> database;
  std::optional<std::filesystem::path> csv;
  std::size_t workers = 0;  // 0: as many as there are cores
  EstimatorOptions estimator;
  std::optional<inference::RelearnOptions> relearn;  // empty: the reference stays as the archive's own is
};

// What is kept of every frame. Lamps and ring profiles are not: the report estimates its few frames again.
struct ReplayRecord {
  Observation observation;
  std::string reason;  // why there is no value; empty if there is one
  std::string fault;   // what was wrong with the frame's files; empty if nothing
  FrameRole role = FrameRole::observation;
};

// The reference after a night that taught something.
struct RelearnedReference {
  inference::Relearner::Settled settled;
  std::optional<ClearReference> reference;
};

struct ReplayResult {
  Site site;
  std::optional<ClearReference> reference;    // from the clear_reference brackets
  std::vector<RelearnedReference> relearned;  // ascending in time
  std::size_t frames = 0;                     // in the archive; more than records if the run was stopped
  std::vector<ReplayRecord> records;
  std::vector<std::string> warnings;
  bool stopped = false;

  // What frames of that time were measured against.
  const std::optional<ClearReference>& reference_at(TimePoint time) const;
};

// Called in the run's thread, frame by frame in order; any of them may be empty.
struct ReplayListener {
  std::function<void(const ReplayRecord&, std::size_t done, std::size_t total)> progress;
  std::function<void(const Site&)> site;           // once, before the first frame
  std::function<void(const FrameResult&)> result;  // with lamps and ring profiles
};

// The clear reference is learned from the archive's clear_reference brackets first; they get records like all
// others. A bad frame is a flagged record and a warning. After a stop everything done is written and
// complete. Throws DataError (bad archive), ConfigError (bad site file), IoError.
ReplayResult run_replay(const ReplayOptions& options, std::stop_token stop, const ReplayListener& listener);

// Pairs for scoring: records that are no clear references, which would be measured by themselves.
std::vector<Observation> scored_observations(const ReplayResult& result);

// Tables and summary as text for people.
std::string format_table(const ReplayResult& result, const std::vector<Truth>& truths);
std::string format_summary(const ReplayResult& result);

// {"lampglow": version, "records": [...], "scores": {...}} as JSON text; scores only with truth.
std::string format_json(const ReplayResult& result, const std::vector<Truth>& truths);
std::string format_scores_json(const ReplayResult& result, const std::vector<Truth>& truths);

}  // namespace lampglow::daemon
