// User and password of a camera, from a file that only the daemon can read.
#pragma once

#include <optional>
#include <string>

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

struct Credentials {
  std::string user;
  std::string password;
};

// Empty if the options name no file. Throws SourceError(no_credentials); the message has the file's name
// only.
std::optional<Credentials> read_credentials(const SourceOptions& options);

}  // namespace lampglow::daemon
