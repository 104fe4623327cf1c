#include "daemon/pictures/tiff_file.h"

#include <algorithm>
#include <cstdarg>
#include <cstdio>

namespace lampglow::daemon {
namespace {

// One strip or tile of an honest picture is smaller than this.
constexpr tmsize_t kMaxAllocation = tmsize_t{1} << 30;

TiffFile& file_of(thandle_t handle) {
  return *static_cast<TiffFile*>(handle);
}

std::uint64_t size_of(const TiffFile& file) {
  return file.source.empty() ? file.written.size() : file.source.size();
}

tmsize_t read(thandle_t handle, void* to, tmsize_t count) {
  TiffFile& file = file_of(handle);
  const std::span<const std::uint8_t> all = file.source.empty() ? file.written : file.source;
  if (file.at >= all.size()) return 0;
  const auto rest = all.subspan(file.at);
  const auto taken = std::min(rest.size(), static_cast<std::size_t>(std::max<tmsize_t>(count, 0)));
  std::copy_n(rest.begin(), taken, static_cast<std::uint8_t*>(to));
  file.at += taken;
  return static_cast<tmsize_t>(taken);
}

tmsize_t write(thandle_t handle, void* from, tmsize_t count) {
  TiffFile& file = file_of(handle);
  if (!file.source.empty()) return 0;
  const auto length = static_cast<std::size_t>(count);
  if (file.at + length > file.written.size()) file.written.resize(file.at + length);
  std::copy_n(static_cast<const std::uint8_t*>(from), length,
              file.written.begin() + static_cast<std::ptrdiff_t>(file.at));
  file.at += length;
  return count;
}

toff_t seek(thandle_t handle, toff_t offset, int whence) {
  TiffFile& file = file_of(handle);
  file.at = offset + (whence == SEEK_CUR ? file.at : whence == SEEK_END ? size_of(file) : 0);
  return file.at;
}

int close(thandle_t) {
  return 0;
}

toff_t size(thandle_t handle) {
  return size_of(file_of(handle));
}

// The bytes are in memory already: libtiff reads them where they are.
int map(thandle_t handle, void** base, toff_t* length) {
  const TiffFile& file = file_of(handle);
  *base = const_cast<std::uint8_t*>(file.source.data());
  *length = file.source.size();
  return file.source.empty() ? 0 : 1;
}

void unmap(thandle_t, void*, toff_t) {}

__attribute__((format(printf, 4, 0))) int complain(TIFF*, void* user, const char*, const char* format,
                                                   std::va_list arguments) {
  TiffFile& file = *static_cast<TiffFile*>(user);
  char text[256];
  std::vsnprintf(text, sizeof text, format, arguments);
  if (file.complaint.empty()) file.complaint = text;
  return 1;  // told; libtiff's own handler would print it
}

int ignore(TIFF*, void*, const char*, const char*, std::va_list) {
  return 1;
}

}  // namespace

void TiffFile::check(bool done) const {
  if (!complaint.empty()) throw PictureError(complaint);
  if (!done) throw PictureError("the picture's data cannot be read");
}

TiffHandle open_tiff(TiffFile& file, const char* mode) {
  const std::unique_ptr<TIFFOpenOptions, decltype(&TIFFOpenOptionsFree)> options(TIFFOpenOptionsAlloc(),
                                                                                 &TIFFOpenOptionsFree);
  if (!options) throw std::bad_alloc();
  TIFFOpenOptionsSetMaxSingleMemAlloc(options.get(), kMaxAllocation);
  TIFFOpenOptionsSetErrorHandlerExtR(options.get(), complain, &file);
  TIFFOpenOptionsSetWarningHandlerExtR(options.get(), ignore, nullptr);
  TiffHandle tiff(
      TIFFClientOpenExt("picture", mode, &file, read, write, seek, close, size, map, unmap, options.get()),
      &TIFFClose);
  file.check(tiff != nullptr);
  return tiff;
}

}  // namespace lampglow::daemon
