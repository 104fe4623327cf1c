// The clear references of cameras over time: the audit trail of relearning in service. Store::put_reference()
// writes it; it is never dropped.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "storage/error.h"
#include "storage/records.h"

namespace lampglow::storage {

// Where a clear reference comes from. Stored numbers.
enum class ReferenceOrigin : int { clear_brackets = 1, relearned = 2, restored = 3 };
std::string_view to_string(ReferenceOrigin value);

struct ReferenceLampRecord {
  std::string id;
  double strength = 0;      // radiance times px², in clear air
  double ln_relearned = 0;  // of strength over what the clear brackets gave
  std::optional<TimePoint> relearned_utc;
  double ln_halo = 0;  // of its halo's strength over an even lamp's, against the mean of all lamps
  std::optional<TimePoint> halo_utc;
};

// A camera's clear reference from a time on.
struct ReferenceRecord {
  std::int64_t number = 0;  // ascending in the order of writing
  TimePoint valid_from_utc{};
  ReferenceOrigin origin = ReferenceOrigin::clear_brackets;
  TimePoint base_utc{};  // of the newest clear bracket that it rests on
  int frames = 0;        // that taught the strengths of this step
  double hours = 0;
  std::optional<double> mor_low_m;  // the lowest of their lower bounds
  std::optional<double> ln_common;  // what all lamps had lost or won
  std::optional<std::int64_t> restored_number;
  int halo_frames = 0;  // of haze and fog, that taught the halos of this step
  std::vector<ReferenceLampRecord> lamps;
};

// Short, read-only questions to a database that a Store may be writing. One per thread.
class ReferenceReader {
 public:
  // Throws StorageError; a file that is not there is `io`.
  explicit ReferenceReader(const std::filesystem::path& file, int busy_timeout_ms = 2000);
  ~ReferenceReader();

  // All of a camera, ascending in number, without their lamps.
  std::vector<ReferenceRecord> references(CameraNumber camera);
  // One of them with its lamps; the one in force now without a number.
  std::optional<ReferenceRecord> reference(CameraNumber camera, std::optional<std::int64_t> number = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lampglow::storage
