#include "daemon/sources/credentials.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "daemon/sources/fault.h"

namespace lampglow::daemon {
namespace {

// A bare name stands for a credential of systemd's LoadCredential=.
std::filesystem::path path_of(const std::string& name) {
  if (name.find('/') != std::string::npos) return name;
  const char* folder = std::getenv("CREDENTIALS_DIRECTORY");
  if (folder == nullptr) {
    throw SourceError(
        Fault::no_credentials,
        "credential '" + name + "': not run with systemd's LoadCredential; give a file's full path");
  }
  return std::filesystem::path(folder) / name;
}

}  // namespace

std::optional<Credentials> read_credentials(const SourceOptions& options) {
  if (options.credentials_file.empty()) return std::nullopt;
  const std::filesystem::path path = path_of(options.credentials_file);
  std::ifstream file(path, std::ios::binary);
  std::string line;
  if (!std::getline(file, line)) {
    throw SourceError(Fault::no_credentials, path.string() + ": can't be read, or is empty");
  }
  if (!line.empty() && line.back() == '\r') line.pop_back();
  const std::size_t colon = line.find(':');
  if (colon == std::string::npos || colon == 0) {
    throw SourceError(Fault::no_credentials, path.string() + ": expected one line USER:PASSWORD");
  }
  return Credentials{line.substr(0, colon), line.substr(colon + 1)};
}

}  // namespace lampglow::daemon
