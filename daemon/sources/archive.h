// A WILD-style archive on disk as a frame source: ARCHIVE/site.toml, frames.csv, images/.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "daemon/sources/frame_source.h"
#include "estimator/learn_reference.h"
#include "estimator/site.h"

namespace lampglow::daemon {

// One exposure of frames.csv.
struct ArchiveFrame {
  std::string file;
  std::optional<double> exposure_s;
  std::optional<double> gain_db;
};

// The rows of frames.csv that share a time and role.
struct ArchiveBracket {
  TimePoint time_utc{};
  FrameRole role = FrameRole::observation;
  std::optional<double> reference_mor_m;
  std::vector<ArchiveFrame> frames;
};

// Throws DataError (exit 65) with every structural problem of the file: a missing column, a bad time or
// number, times that go back, one bracket with two roles, a path that leaves the archive. IoError if it
// cannot be read.
std::vector<ArchiveBracket> read_frames_csv(const std::filesystem::path& archive);

// Reads a bracket's pictures. One that fails is left out, flagged and told in `fault`.
Bracket load_bracket(const std::filesystem::path& archive, const ArchiveBracket& entry, const Camera& camera);

// Those of `brackets` that are clear references, read as they are asked for.
ClearBrackets clear_brackets(const std::filesystem::path& archive, std::vector<ArchiveBracket> brackets,
                             const Camera& camera);

class ArchiveSource : public FrameSource {
 public:
  // Reads frames.csv at once; pictures as next() is called. Throws as read_frames_csv.
  ArchiveSource(std::filesystem::path archive, Camera camera);

  std::string name() const override { return "archive:" + archive_.string(); }
  std::optional<Bracket> next(std::stop_token stop) override;

  // All brackets, in the order in which next() gives them.
  const std::vector<ArchiveBracket>& brackets() const { return brackets_; }

 private:
  std::filesystem::path archive_;
  Camera camera_;
  std::vector<ArchiveBracket> brackets_;
  std::size_t at_ = 0;
};

}  // namespace lampglow::daemon
