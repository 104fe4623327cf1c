// Pictures as files or bytes (PNG, JPEG, TIFF) to digital numbers, for archives, snapshots and commands.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "estimator/photometry/camera.h"
#include "estimator/photometry/image.h"
#include "estimator/quality.h"

namespace lampglow::daemon {

// Either pixels, or a flag and a fault in words.
struct DecodedImage {
  Image<std::uint16_t> pixels;  // mono, or the green channel; not scaled
  bool monochrome = true;       // false: the picture had colour
  QualityFlags quality;         // frame_* flags
  std::string fault;            // "NAME: what was expected, what is there"; empty if all is well

  bool good() const { return fault.empty(); }
};

// Size and depth must be the camera's; they are checked in the header, before any pixel is decoded. A
// truncated picture is refused as a whole. `name` is for the fault's text. Never throws for bad bytes.
DecodedImage decode_image(std::span<const std::uint8_t> bytes, const std::string& name, const Camera& camera);

// The same for a file below `folder`: the relative path may not leave the folder and no part of it may be a
// symbolic link; only a regular file of a plausible size is read.
DecodedImage load_image(const std::filesystem::path& folder, const std::string& relative,
                        const Camera& camera);

// For commands that are given a single picture (survey, render): size and depth of the picture as it is.
// Refuses more than max_pixels. Throws DataError, IoError.
struct PlainImage {
  Image<std::uint16_t> pixels;
  int bit_depth = 8;  // of the file's samples: 8 or 16
  bool monochrome = true;
};
PlainImage load_plain_image(const std::filesystem::path& path, std::int64_t max_pixels = 100'000'000);

// Why a path may not stand in an archive ("expected a relative path ..."); empty if it may.
std::string refuse_path(const std::filesystem::path& folder, const std::string& relative);

}  // namespace lampglow::daemon
