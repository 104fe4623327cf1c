// What the commands that look into a station's database share.
#pragma once

#include <functional>
#include <string>

#include "storage/reader.h"

namespace lampglow::daemon {

// Throws IoError if there is no such file.
void needs_database(const std::string& file);

// Runs `work`; what storage throws comes out with the right exit code: DataError or IoError.
void with_storage_errors(const std::function<void()>& work);

// The camera of that name, or the only one without a name. Throws UsageError that lists the cameras.
storage::CameraRecord camera_of(storage::Reader& reader, const std::string& name);

}  // namespace lampglow::daemon
