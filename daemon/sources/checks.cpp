#include "daemon/sources/checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace lampglow::daemon {
namespace {

std::string size_text(int width_px, int height_px) {
  return fmt::format("{}x{}", width_px, height_px);
}

std::uint64_t hash_step(std::uint64_t hash, std::uint64_t value) {
  return (hash ^ value) * 0x100000001b3ULL;
}

}  // namespace

bool is_black(const Image<std::uint16_t>& picture) {
  if (picture.empty()) return true;
  const auto [low, high] = std::ranges::minmax(picture.pixels);
  return high - low <= 1;
}

bool has_grey_fill(const Image<std::uint16_t>& picture, int bit_depth) {
  if (picture.empty()) return false;
  const double full = std::ldexp(1.0, bit_depth);
  const int fill = picture.pixels.back();
  if (std::abs(fill - full / 2) > 0.04 * full) return false;
  const auto rows = static_cast<std::size_t>(std::max(1, (picture.height_px + 15) / 16));
  const auto count = static_cast<std::ptrdiff_t>(rows * static_cast<std::size_t>(picture.width_px));
  const double tolerance = full / 256;
  return std::all_of(picture.pixels.end() - count, picture.pixels.end(),
                     [=](std::uint16_t value) { return std::abs(value - fill) <= tolerance; });
}

bool follows_exposure(const Bracket& bracket, int bit_depth) {
  const Exposure &shortest = bracket.exposures.front(), &longest = bracket.exposures.back();
  if (!shortest.exposure_s || !longest.exposure_s || *longest.exposure_s < 4 * *shortest.exposure_s)
    return true;
  const auto mean_dn = [](const Exposure& exposure) {
    const auto& pixels = exposure.pixels.pixels;
    return std::accumulate(pixels.begin(), pixels.end(), 0.0) / static_cast<double>(pixels.size());
  };
  const double full_dn = std::ldexp(1.0, bit_depth) - 1;
  const double dark_dn = mean_dn(shortest);
  const bool shows_light = std::ranges::max(shortest.pixels.pixels) > full_dn / 4;
  return !shows_light || dark_dn > 0.9 * full_dn || mean_dn(longest) > 1.02 * dark_dn;
}

std::uint64_t picture_hash(const Image<std::uint16_t>& picture) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  hash = hash_step(hash, static_cast<std::uint64_t>(picture.width_px));
  hash = hash_step(hash, static_cast<std::uint64_t>(picture.height_px));
  for (const std::uint16_t value : picture.pixels) hash = hash_step(hash, value);
  return hash;
}

CheckResult FrameChecker::check_size(const Exposure& exposure) {
  const int width_px = exposure.pixels.width_px, height_px = exposure.pixels.height_px;
  const bool changed = last_width_px_ != 0 && (width_px != last_width_px_ || height_px != last_height_px_);
  const std::string before = size_text(last_width_px_, last_height_px_);
  last_width_px_ = width_px;
  last_height_px_ = height_px;
  if (changed) {
    return {Fault::resolution_changed,
            fmt::format("the picture is {} now, it was {}", size_text(width_px, height_px), before)};
  }
  if ((options_.width_px != 0 && width_px != options_.width_px) ||
      (options_.height_px != 0 && height_px != options_.height_px)) {
    return {Fault::wrong_size,
            fmt::format("the picture is {}, the site file says {}", size_text(width_px, height_px),
                        size_text(options_.width_px, options_.height_px))};
  }
  return {};
}

bool FrameChecker::is_frozen(const Bracket& bracket) {
  std::uint64_t hash = 0;
  for (const Exposure& exposure : bracket.exposures) hash = hash_step(hash, picture_hash(exposure.pixels));
  repeats_ = last_hash_ == hash ? repeats_ + 1 : 1;
  last_hash_ = hash;
  return options_.frozen_after > 0 && repeats_ >= options_.frozen_after;
}

CheckResult FrameChecker::check(const Bracket& bracket) {
  if (bracket.exposures.empty()) return {Fault::undecodable, "no exposure in the bracket"};
  const bool frozen = is_frozen(bracket);
  for (const Exposure& exposure : bracket.exposures) {
    CheckResult size = check_size(exposure);
    if (size.fault != Fault::none) return size;
    if (has_grey_fill(exposure.pixels, options_.bit_depth)) {
      return {Fault::grey, exposure.name + ": the picture's lower part is flat grey"};
    }
    if (is_black(exposure.pixels)) {
      return {Fault::black, exposure.name + ": all pixels have one value"};
    }
  }
  if (frozen) return {Fault::frozen, fmt::format("the same picture {} times running", repeats_)};
  return {};
}

}  // namespace lampglow::daemon
