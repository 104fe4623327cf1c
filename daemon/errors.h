// The errors that end a command, each with its exit code (sysexits.h).
#pragma once

#include <stdexcept>
#include <string>

namespace lampglow::daemon {

inline constexpr int kExitUsage = 64;     // EX_USAGE: bad command line
inline constexpr int kExitData = 65;      // EX_DATAERR: bad archive, image, database
inline constexpr int kExitInternal = 70;  // EX_SOFTWARE
inline constexpr int kExitIo = 74;        // EX_IOERR
inline constexpr int kExitConfig = 78;    // EX_CONFIG: bad configuration or site file
inline constexpr int kExitSignal = 128;   // and the signal's number, as shells give it

class CommandError : public std::runtime_error {
 public:
  CommandError(int exit_code, const std::string& message)
      : std::runtime_error(message), exit_code_(exit_code) {}
  int exit_code() const { return exit_code_; }

 private:
  int exit_code_;
};

struct UsageError : CommandError {
  explicit UsageError(const std::string& message) : CommandError(kExitUsage, message) {}
};
struct DataError : CommandError {
  explicit DataError(const std::string& message) : CommandError(kExitData, message) {}
};
struct ConfigError : CommandError {
  explicit ConfigError(const std::string& message) : CommandError(kExitConfig, message) {}
};
struct IoError : CommandError {
  explicit IoError(const std::string& message) : CommandError(kExitIo, message) {}
};

// Ended by a signal before it was ready for it.
struct EndedBySignal : CommandError {
  EndedBySignal(int signal, const std::string& message) : CommandError(kExitSignal + signal, message) {}
};

}  // namespace lampglow::daemon
