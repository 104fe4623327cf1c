// What can go wrong with the database, sorted by what the caller can do about it.
#pragma once

#include <stdexcept>
#include <string>

namespace lampglow::storage {

class StorageError : public std::runtime_error {
 public:
  enum class Kind {
    corrupt,    // not a database, or damaged: set it aside
    too_new,    // written by a later lampglow: do not touch it
    full,       // no room on the disk: try again later
    read_only,  // the disk or the file cannot be written
    busy,       // another process holds it
    stopped,    // broken off, because the caller asked for it
    io,         // anything else the disk says
  };
  StorageError(Kind kind, const std::string& message) : std::runtime_error(message), kind_(kind) {}
  Kind kind() const { return kind_; }

 private:
  Kind kind_;
};

}  // namespace lampglow::storage
