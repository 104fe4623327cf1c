#include "estimator/scattering/glow_table_file.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>

namespace lampglow::scattering {
namespace {

static_assert(std::endian::native == std::endian::little, "the glow table is little-endian");

template <typename T>
void put(std::vector<std::byte>& out, const T& value) {
  out.resize(out.size() + sizeof(T));
  std::memcpy(out.data() + out.size() - sizeof(T), &value, sizeof(T));
}

template <typename T>
T take(std::span<const std::byte>& in) {
  T value;
  std::memcpy(&value, in.data(), sizeof(T));
  in = in.subspan(sizeof(T));
  return value;
}

void put_floats(std::vector<std::byte>& out, const std::vector<float>& values) {
  const std::size_t size = values.size() * sizeof(float);
  out.resize(out.size() + size);
  std::memcpy(out.data() + out.size() - size, values.data(), size);
}

std::vector<float> take_floats(std::span<const std::byte>& in, std::size_t count) {
  std::vector<float> values(count);
  std::memcpy(values.data(), in.data(), count * sizeof(float));
  in = in.subspan(count * sizeof(float));
  return values;
}

[[noreturn]] void refuse(const std::string& reason) {
  throw std::runtime_error("glow table: " + reason);
}

}  // namespace

std::uint32_t crc32(std::span<const std::byte> bytes) {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    table[i] = i;
    for (int bit = 0; bit < 8; ++bit) table[i] = (table[i] >> 1) ^ ((table[i] & 1) ? 0xedb88320u : 0u);
  }
  std::uint32_t crc = 0xffffffffu;
  for (const std::byte byte : bytes)
    crc = (crc >> 8) ^ table[(crc ^ static_cast<std::uint32_t>(byte)) & 0xffu];
  return ~crc;
}

std::vector<std::byte> write_glow_table(const GlowTableContents& contents) {
  std::vector<std::byte> out;
  put(out, kGlowTableMagic);
  put(out, kGlowTableVersion);
  put(out, static_cast<std::uint32_t>(contents.axes.size()));
  for (const SplineAxis& axis : contents.axes) {
    put(out, axis.first);
    put(out, axis.step);
    put(out, static_cast<std::uint32_t>(axis.nodes));
  }
  put_floats(out, contents.single);
  put_floats(out, contents.multiple);
  put(out, crc32(out));
  return out;
}

GlowTableContents read_glow_table(std::span<const std::byte> file) {
  if (file.size() < kGlowTableHeader + 4)
    refuse("cut short: " + std::to_string(file.size()) + " bytes, the header alone has " +
           std::to_string(kGlowTableHeader));
  std::span<const std::byte> rest = file;
  if (take<std::array<char, 8>>(rest) != kGlowTableMagic) refuse("not a glow table (magic bytes differ)");
  if (const auto version = take<std::uint32_t>(rest); version != kGlowTableVersion)
    refuse("version " + std::to_string(version) + ", this program reads version " +
           std::to_string(kGlowTableVersion));
  if (const auto count = take<std::uint32_t>(rest); count != 4)
    refuse(std::to_string(count) + " axes, expected 4");
  GlowTableContents contents;
  std::array<std::size_t, 4> sizes{};
  for (std::size_t i = 0; i < 4; ++i) {
    SplineAxis& axis = contents.axes[i];
    axis.first = take<double>(rest);
    axis.step = take<double>(rest);
    axis.nodes = take<std::uint32_t>(rest);
    if (!std::isfinite(axis.first) || !(axis.step > 0) || axis.nodes < 2 || axis.nodes > 1000)
      refuse("axis " + std::to_string(i) + " is not a grid");
    sizes[i] = axis.coefficients();
  }
  const std::size_t single = sizes[1] * sizes[2] * sizes[3], multiple = single * sizes[0];
  const std::size_t expected = kGlowTableHeader + (single + multiple) * sizeof(float) + 4;
  if (file.size() != expected)
    refuse(std::to_string(file.size()) + " bytes, its axes ask for " + std::to_string(expected));
  contents.single = take_floats(rest, single);
  contents.multiple = take_floats(rest, multiple);
  if (take<std::uint32_t>(rest) != crc32(file.first(file.size() - 4)))
    refuse("checksum wrong: the file is damaged");
  return contents;
}

}  // namespace lampglow::scattering
