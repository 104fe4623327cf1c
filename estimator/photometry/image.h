// A picture in memory, rows top to bottom. Pixel (column, row) covers [column, column+1) x [row, row+1): its
// centre is at .5.
#pragma once

#include <cstddef>
#include <vector>

namespace lampglow {

template <typename T>
struct Image {
  int width_px = 0;
  int height_px = 0;
  std::vector<T> pixels;  // width_px * height_px, row by row

  Image() = default;
  Image(int width, int height, T value = T{})
      : width_px(width),
        height_px(height),
        pixels(static_cast<size_t>(width) * static_cast<size_t>(height), value) {}

  bool empty() const { return pixels.empty(); }
  bool contains(int column, int row) const {
    return column >= 0 && row >= 0 && column < width_px && row < height_px;
  }
  T& at(int column, int row) { return pixels[index(column, row)]; }
  const T& at(int column, int row) const { return pixels[index(column, row)]; }

 private:
  size_t index(int column, int row) const {
    return static_cast<size_t>(row) * static_cast<size_t>(width_px) + static_cast<size_t>(column);
  }
};

}  // namespace lampglow
