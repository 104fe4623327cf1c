// A file that is written row by row and appears under its name only when it is complete.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "daemon/config/descriptor.h"

namespace lampglow::daemon {

class PendingFile {
 public:
  // Opens FILE.XXXXXX beside the file. Throws IoError.
  explicit PendingFile(std::filesystem::path path);
  ~PendingFile();  // removes what was not published
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;

  void write(std::string_view text);
  // Syncs and renames to the file's name. Throws IoError.
  void publish();

 private:
  void flush();

  std::filesystem::path path_;
  std::string temporary_;
  Descriptor file_;
  std::string buffer_;
};

}  // namespace lampglow::daemon
