// A picture in memory, rows top to bottom. Pixel (column, row) covers [column, column+1) x [row, row+1): its
// centre is at .5.
#pragma once

#include <cstddef>
#include <vector>

#include "estimator/photometry/pixel_memory.h"

namespace lampglow {

template <typename T>
using Pixels = std::vector<T, PixelAllocator<T>>;

template <typename T>
struct Image {
  int width_px = 0;
  int height_px = 0;
  Pixels<T> pixels;  // width_px * height_px, row by row

  Image() = default;
  Image(int width, int height, T value = T{})
      : width_px(width),
        height_px(height),
        pixels(static_cast<size_t>(width) * static_cast<size_t>(height), value) {}

  // For what writes every pixel: their values are whatever is in the memory.
  static Image unfilled(int width, int height) {
    Image image;
    image.width_px = width, image.height_px = height;
    image.pixels.resize(static_cast<size_t>(width) * static_cast<size_t>(height));
    return image;
  }

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
