#include "daemon/commands/database.h"

#include <filesystem>

#include "daemon/errors.h"

namespace lampglow::daemon {

void needs_database(const std::string& file) {
  std::error_code error;
  if (std::filesystem::is_regular_file(file, error)) return;
  if (error && error != std::errc::no_such_file_or_directory && error != std::errc::not_a_directory)
    throw IoError(file + ": " + error.message());
  throw IoError(file + ": there is no such database");
}

void with_storage_errors(const std::function<void()>& work) {
  try {
    work();
  } catch (const storage::StorageError& error) {
    using Kind = storage::StorageError::Kind;
    if (error.kind() == Kind::corrupt || error.kind() == Kind::too_new) throw DataError(error.what());
    throw IoError(error.what());
  }
}

storage::CameraRecord camera_of(storage::Reader& reader, const std::string& name) {
  const auto cameras = reader.cameras();
  if (name.empty() && cameras.size() == 1) return cameras.front();
  std::string names;
  for (const auto& camera : cameras) {
    if (camera.name == name) return camera;
    names += (names.empty() ? "" : ", ") + camera.name;
  }
  throw UsageError("--camera: expected one of " + names + (name.empty() ? "" : ", got " + name));
}

}  // namespace lampglow::daemon
