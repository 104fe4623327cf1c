#include "daemon/station/remembered.h"

#include "daemon/station/log.h"
#include "storage/reader.h"

namespace lampglow::daemon {
namespace {

std::vector<FrameResult> read_last_hour(storage::Reader& reader, const std::string& name) {
  std::vector<FrameResult> results;
  const auto camera = reader.camera(name);
  const auto span = camera ? reader.span(camera->number) : std::nullopt;
  if (!span) return results;
  const TimePoint last = span->second;
  const storage::ObservationQuery query{
      camera->number, last - std::chrono::hours(1), last + std::chrono::milliseconds(1), 0, {}, 10000};
  for (const storage::ObservationRow& row : reader.observations(query)) {
    FrameResult result;
    result.observation = row.observation;
    result.reason = row.reason;
    if (row.observation.time_utc == last)
      for (const storage::LampFitRow& fit : reader.fits(camera->number, last))
        result.lamps.push_back(fit.fit);
    results.push_back(std::move(result));
  }
  return results;
}

}  // namespace

std::vector<FrameResult> last_hour(const std::filesystem::path& database, const std::string& camera) {
  try {
    storage::Reader reader(database);
    return read_last_hour(reader, camera);
  } catch (const storage::StorageError& error) {
    log(LogLevel::warning, "the last observations could not be read back", {{"reason", error.what()}});
    return {};
  }
}

std::vector<storage::PictureRecord> kept_pictures(const std::filesystem::path& database, TimePoint now) {
  try {
    storage::Reader reader(database);
    return reader.pictures({}, TimePoint{}, now + std::chrono::hours(24), 1 << 30);
  } catch (const storage::StorageError&) {
    return {};
  }
}

}  // namespace lampglow::daemon
