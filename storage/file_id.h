// Which file stands at a path: another one may be put there while the old one is open.
#pragma once

#include <fcntl.h>
#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <optional>

namespace lampglow::storage {

struct FileId {
  std::uint64_t device = 0;
  std::uint64_t inode = 0;   // a file system gives it to another file once this one is gone
  std::int64_t born_ns = 0;  // 0 where the file system does not tell
  bool operator==(const FileId&) const = default;
};

// Empty if there is none, or it cannot be looked at.
inline std::optional<FileId> file_id(const std::filesystem::path& path) {
  struct statx now {};
  if (::statx(AT_FDCWD, path.c_str(), 0, STATX_INO | STATX_BTIME, &now) != 0) return std::nullopt;
  const bool born = (now.stx_mask & STATX_BTIME) != 0;
  return FileId{std::uint64_t{now.stx_dev_major} << 32 | now.stx_dev_minor, now.stx_ino,
                born ? now.stx_btime.tv_sec * 1'000'000'000 + now.stx_btime.tv_nsec : 0};
}

}  // namespace lampglow::storage
