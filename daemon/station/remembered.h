// What the database remembers from before a restart.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "storage/records.h"

namespace lampglow::daemon {

// The results of the camera's last hour, the last one with its lamps. A database that cannot be read
// remembers nothing, and the log says so.
std::vector<FrameResult> last_hour(const std::filesystem::path& database, const std::string& camera);

// The pictures that were kept; the keeper tells of a database that cannot be read.
std::vector<storage::PictureRecord> kept_pictures(const std::filesystem::path& database, TimePoint now);

}  // namespace lampglow::daemon
