// Pictures for `render`: float planes, read from and written to EXR, TIFF, PNG and JPEG.
#pragma once

#include <string>
#include <vector>

namespace lampglow::daemon {

// Of the digital numbers that the file has.
struct Planes {
  int width_px = 0;
  int height_px = 0;
  int bits = 8;                            // of the file's samples: 8, 16, or 32 for float
  std::vector<std::vector<float>> planes;  // grey, or red, green, blue; width_px * height_px each

  bool real() const { return bits == 32; }
};

// Transparency is left out. Throws IoError, DataError.
Planes read_planes(const std::string& path);

// 8-bit pictures carry the sRGB curve, everything deeper is linear; full scale stays what it is.
void to_linear(Planes& picture);

// Throws UsageError where write_planes could not: to be asked before the work. Brightness of a float picture
// has no end that could be white: it is not squeezed into integers.
void refuse_unwritable(const std::string& path, const Planes& picture);

// The format is that of the path's extension, the samples are those of the file that was read; an .exr is
// float and linear. What was made linear gets its curve back. Throws IoError.
void write_planes(const std::string& path, Planes picture);

}  // namespace lampglow::daemon
