// A TIFF in memory as libtiff wants to see it. Stays within this folder.
#pragma once

#include <tiffio.h>

#include <memory>
#include <span>
#include <string>

#include "daemon/pictures/picture.h"

namespace lampglow::daemon {

// Read from `source`, or written to `written`; libtiff's complaints end up in `complaint`, never on stderr.
struct TiffFile {
  std::span<const std::uint8_t> source;
  Bytes written;
  std::uint64_t at = 0;
  std::string complaint;  // the first error; warnings are of unknown tags and such, and left out

  // Throws PictureError with the complaint if there is one or `done` is false.
  void check(bool done) const;
};

using TiffHandle = std::unique_ptr<TIFF, decltype(&TIFFClose)>;

// `file` is to outlive the handle. Throws PictureError.
TiffHandle open_tiff(TiffFile& file, const char* mode);

}  // namespace lampglow::daemon
