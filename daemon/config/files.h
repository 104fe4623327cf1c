// Whole files, read with a bound and written so that a reader never sees half of one.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace lampglow::daemon {

// Text files that people write (site, configuration, CSV) are smaller than this.
inline constexpr std::size_t kMaxTextFileBytes = std::size_t{64} << 20;

// The file's bytes. Throws IoError: not there, no regular file, larger than max_bytes, unreadable.
std::string read_text_file(const std::filesystem::path& path, std::size_t max_bytes = kMaxTextFileBytes);

// Writes beside the file, syncs and renames: the old content stays until the new one is complete.
// Throws IoError.
void write_file_atomically(const std::filesystem::path& path, std::string_view content);

}  // namespace lampglow::daemon
