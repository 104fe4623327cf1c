#include "daemon/pictures/image_header.h"

#include <algorithm>
#include <array>

namespace lampglow::daemon {
namespace {

// Bytes with bounds: a read past the end gives 0 and is remembered.
class Reader {
 public:
  Reader(std::span<const std::uint8_t> bytes, bool little_endian) : bytes_(bytes), little_(little_endian) {}
  bool good() const { return good_; }
  std::uint64_t size() const { return bytes_.size(); }

  std::uint32_t u8(std::uint64_t at) {
    if (at < bytes_.size()) return bytes_[at];
    good_ = false;
    return 0;
  }
  std::uint32_t u16(std::uint64_t at) {
    const std::uint32_t a = u8(at), b = u8(at + 1);
    return little_ ? b << 8 | a : a << 8 | b;
  }
  std::uint32_t u32(std::uint64_t at) {
    const std::uint32_t a = u16(at), b = u16(at + 2);
    return little_ ? b << 16 | a : a << 16 | b;
  }

 private:
  std::span<const std::uint8_t> bytes_;
  bool little_;
  bool good_ = true;
};

bool starts_with(std::span<const std::uint8_t> bytes, std::string_view magic) {
  return bytes.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin(),
                    [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
}

// PNG (ISO/IEC 15948): signature, IHDR, chunks of length, type, data, CRC up to IEND.
std::optional<ImageHeader> read_png(std::span<const std::uint8_t> bytes) {
  constexpr std::uint32_t kIhdr = 0x49484452, kIend = 0x49454E44;
  constexpr std::array<int, 7> kChannels{1, 0, 3, 3, 2, 0, 4};  // by colour type; a palette gives colours
  Reader in(bytes, false);
  const std::uint32_t type = in.u8(25);
  if (in.u32(8) != 13 || in.u32(12) != kIhdr || type >= kChannels.size() || kChannels[type] == 0)
    return std::nullopt;
  ImageHeader header{ImageFormat::png, in.u32(16), in.u32(20), static_cast<int>(in.u8(24)), kChannels[type]};
  if (!in.good()) return std::nullopt;
  for (std::uint64_t at = 8; at + 12 <= bytes.size();) {
    const std::uint64_t next = at + 12 + in.u32(at);
    if (in.u32(at + 4) == kIend) header.complete = next <= bytes.size();
    at = next;
  }
  return header;
}

// Where the entropy-coded data from `at` on ends: at a marker that is no restart; the file's size if it has
// none.
std::uint64_t skip_entropy_coded(std::span<const std::uint8_t> bytes, std::uint64_t at) {
  for (; at + 1 < bytes.size(); ++at) {
    if (bytes[at] != 0xFF) continue;
    const std::uint8_t next = bytes[at + 1];
    if (next != 0 && next != 0xFF && !(next >= 0xD0 && next <= 0xD7)) return at;
  }
  return bytes.size();
}

// JPEG (ITU-T T.81): markers with lengths; the frame header SOF0, SOF1 or SOF2; scans; EOI.
std::optional<ImageHeader> read_jpeg(std::span<const std::uint8_t> bytes) {
  Reader in(bytes, false);
  std::optional<ImageHeader> header;
  std::uint64_t at = 2;
  while (at + 1 < bytes.size() && in.u8(at) == 0xFF) {
    const std::uint32_t marker = in.u8(at + 1);
    if (marker == 0xFF) {  // fill byte
      ++at;
      continue;
    }
    if (marker == 0xD9) {
      if (header) header->complete = true;
      return header;
    }
    const std::uint32_t length = in.u16(at + 2);
    if (length < 2 && in.good()) return header;
    if (marker >= 0xC0 && marker <= 0xC2 && !header) {
      header = ImageHeader{ImageFormat::jpeg, in.u16(at + 7), in.u16(at + 5), static_cast<int>(in.u8(at + 4)),
                           static_cast<int>(in.u8(at + 9))};
    }
    if (!in.good()) return ImageHeader{ImageFormat::jpeg};  // cut off
    at += 2 + length;
    if (marker == 0xDA) at = skip_entropy_coded(bytes, at);
  }
  if (!header && at + 1 >= bytes.size()) return ImageHeader{ImageFormat::jpeg};
  return header;
}

// One entry of a TIFF directory: type SHORT (3) or LONG (4), one or several values.
struct TiffEntry {
  bool seen = false;
  std::uint32_t type = 0;
  std::uint64_t count = 0;
  std::uint64_t at = 0;  // of the first value
};

std::uint32_t tiff_value(Reader& in, const TiffEntry& entry, std::uint64_t index) {
  return entry.type == 3 ? in.u16(entry.at + 2 * index) : in.u32(entry.at + 4 * index);
}

struct TiffDirectory {
  TiffEntry width, height, bits, channels, offsets, lengths, rows_per_strip, tile_width, tile_height;
  // The values of every entry lie within the file, and those above are there once: of two, the decoder may
  // take the other one.
  bool sound = true;

  TiffEntry* entry(std::uint32_t tag) {
    switch (tag) {
      case 256:
        return &width;
      case 257:
        return &height;
      case 258:
        return &bits;
      case 277:
        return &channels;
      case 273:  // strips
      case 324:  // tiles
        return &offsets;
      case 279:
      case 325:
        return &lengths;
      case 278:
        return &rows_per_strip;
      case 322:
        return &tile_width;
      case 323:
        return &tile_height;
      default:
        return nullptr;
    }
  }
};

TiffDirectory read_directory(Reader& in, std::uint64_t at) {
  constexpr std::array<std::uint64_t, 13> kTypeBytes{0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8};
  TiffDirectory directory;
  const std::uint32_t entries = in.u16(at);
  for (std::uint32_t i = 0; i < entries && in.good(); ++i) {
    const std::uint64_t entry_at = at + 2 + 12 * std::uint64_t{i};
    TiffEntry entry{true, in.u16(entry_at + 2), in.u32(entry_at + 4), entry_at + 8};
    const std::uint64_t length = entry.count * (entry.type < kTypeBytes.size() ? kTypeBytes[entry.type] : 1);
    if (length > 4) entry.at = in.u32(entry_at + 8);
    if (entry.at + length > in.size()) directory.sound = false;
    TiffEntry* wanted = directory.entry(in.u16(entry_at));
    if (wanted == nullptr) continue;
    if (wanted->seen || (entry.type != 3 && entry.type != 4)) directory.sound = false;
    *wanted = entry;
  }
  return directory;
}

// Every strip or tile lies within the file.
bool tiff_complete(Reader& in, const TiffDirectory& directory) {
  if (directory.offsets.count == 0 || directory.offsets.count != directory.lengths.count) return false;
  for (std::uint64_t i = 0; i < directory.offsets.count && in.good(); ++i) {
    const std::uint64_t end =
        std::uint64_t{tiff_value(in, directory.offsets, i)} + tiff_value(in, directory.lengths, i);
    if (end > in.size()) return false;
  }
  return in.good();
}

// A decoder makes room for a whole strip or tile, whatever the picture's size: one far larger than the
// picture is a bomb. Tiles are padded; "all rows" may be said as 2^32-1.
bool tiff_pieces_fit(Reader& in, const TiffDirectory& directory, const ImageHeader& header) {
  constexpr std::uint64_t kPadding_px = 1U << 20;
  const auto value = [&in](const TiffEntry& entry) {
    return entry.count == 0 ? 0 : std::uint64_t{tiff_value(in, entry, 0)};
  };
  const auto width = static_cast<std::uint64_t>(header.width_px);
  const std::uint64_t most_px = width * static_cast<std::uint64_t>(header.height_px) + kPadding_px;
  const std::uint64_t rows = value(directory.rows_per_strip);
  if (rows != 0xFFFF'FFFF && rows * width > most_px) return false;
  const std::uint64_t tile_height = value(directory.tile_height);
  // Where only one side of a tile is told, a decoder makes up the other one.
  if (directory.tile_width.seen != directory.tile_height.seen) return false;
  return tile_height == 0 || value(directory.tile_width) <= most_px / tile_height;
}

// TIFF 6.0, first picture of the file.
std::optional<ImageHeader> read_tiff(std::span<const std::uint8_t> bytes, bool little_endian) {
  Reader in(bytes, little_endian);
  const TiffDirectory directory = read_directory(in, in.u32(4));
  if (directory.width.count == 0 || directory.height.count == 0) {
    // The directory commonly stands at the end: without it the file is a TIFF that was cut off.
    if (in.good()) return std::nullopt;
    return ImageHeader{ImageFormat::tiff};
  }
  ImageHeader header{ImageFormat::tiff, tiff_value(in, directory.width, 0),
                     tiff_value(in, directory.height, 0),
                     directory.bits.count ? static_cast<int>(tiff_value(in, directory.bits, 0)) : 1,
                     directory.channels.count ? static_cast<int>(tiff_value(in, directory.channels, 0)) : 1};
  if (!in.good()) return ImageHeader{ImageFormat::tiff};
  header.complete = directory.sound && tiff_pieces_fit(in, directory, header) && tiff_complete(in, directory);
  return header;
}

}  // namespace

std::optional<ImageHeader> read_image_header(std::span<const std::uint8_t> bytes) {
  using namespace std::string_view_literals;
  if (starts_with(bytes, "\x89PNG\r\n\x1A\n"sv)) return read_png(bytes);
  if (starts_with(bytes, "\xFF\xD8\xFF"sv)) return read_jpeg(bytes);
  if (starts_with(bytes, "II*\0"sv)) return read_tiff(bytes, true);
  if (starts_with(bytes, "MM\0*"sv)) return read_tiff(bytes, false);
  return std::nullopt;
}

}  // namespace lampglow::daemon
