// The glow table's file: what is in it, and how it is written. See docs/glow-table.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "estimator/scattering/bspline.h"

namespace lampglow::scattering {

inline constexpr std::array<char, 8> kGlowTableMagic = {'L', 'G', 'G', 'L', 'O', 'W', '\r', '\n'};
inline constexpr std::uint32_t kGlowTableVersion = 1;
// Magic, version, axis count, then first, step (doubles) and nodes (32 bits) of four axes.
inline constexpr std::size_t kGlowTableHeader = 8 + 4 + 4 + 4 * (8 + 8 + 4);

struct GlowTableContents {
  std::array<SplineAxis, 4> axes;  // sqrt(1 - ω0), -ln(1 - q), ln T, ln θ
  std::vector<float> single, multiple;
};

std::vector<std::byte> write_glow_table(const GlowTableContents& contents);
// Throws std::runtime_error with the reason.
GlowTableContents read_glow_table(std::span<const std::byte> file);

// CRC-32 of IEEE 802.3, as in zip and PNG.
std::uint32_t crc32(std::span<const std::byte> bytes);

}  // namespace lampglow::scattering
