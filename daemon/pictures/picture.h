// A picture on its way between a file's bytes and memory: row by row, so that nobody needs it twice. Colours
// stand as red, green, blue, alpha.
#pragma once

#include <cstdint>
#include <span>
#include <stdexcept>
#include <variant>
#include <vector>

namespace lampglow::daemon {

struct PictureShape {
  int width_px = 0;
  int height_px = 0;
  int channels = 1;  // 1 grey, 3 red green blue, 4 with alpha
  int bits = 8;      // of a sample: 8 or 16 whole numbers, 32 float
};

// Samples of one row, or of a whole picture row by row; which of the three the shape's bits say.
using Samples =
    std::variant<std::span<const std::uint8_t>, std::span<const std::uint16_t>, std::span<const float>>;

// Bytes that are damaged, or a kind of picture that is not read; what() has no file's name.
struct PictureError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Where a decoder puts a picture. What it throws passes through the decoder.
class RowSink {
 public:
  virtual ~RowSink() = default;

  // Once, before any pixel is decoded and before room is made for it: throws what it will to refuse.
  virtual void begin(const PictureShape& shape) = 0;

  // Every row once, in any order; width_px * channels samples, there only during the call.
  virtual void take(int row, Samples samples) = 0;
};

// A picture in memory, to be encoded.
struct PictureView {
  PictureShape shape;
  Samples samples;  // width_px * height_px * channels
};

using Bytes = std::vector<std::uint8_t>;

}  // namespace lampglow::daemon
