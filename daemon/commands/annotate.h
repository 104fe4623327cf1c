// A picture with marks for people: lamps as circles, boxes for day targets, each with its label.
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>

#include "estimator/photometry/image.h"

namespace lampglow::daemon {

struct Mark {
  enum class Colour { lamp, moving, target };
  double x_px = 0, y_px = 0;           // centre of the circle, or the box's upper left corner
  double radius_px = 8;                // circle
  double width_px = 0, height_px = 0;  // box; a circle is drawn where these are 0
  std::string label;
  Colour colour = Colour::lamp;
};

// Writes a PNG. Brightness is stretched (asinh above the median) so that dark surroundings can be seen.
// Throws IoError.
void write_annotated(const std::filesystem::path& path, const Image<std::uint16_t>& picture,
                     std::span<const Mark> marks);

}  // namespace lampglow::daemon
