// Whole pictures from a live camera, through the decoder and the checks that every source shares.
#include <cstdint>
#include <span>
#include <vector>

#include "daemon/sources/checks.h"
#include "daemon/sources/fault.h"
#include "daemon/sources/live_frame.h"

namespace {

using namespace lampglow;

std::uint32_t crc_of(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = ~0U;
  for (const std::uint8_t byte : bytes) {
    crc ^= byte;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320U : 0);
  }
  return ~crc;
}

std::uint32_t big_endian(const std::uint8_t* at) {
  return std::uint32_t{at[0]} << 24 | std::uint32_t{at[1]} << 16 | std::uint32_t{at[2]} << 8 | at[3];
}

// A PNG whose chunks were changed, with their checksums put right: else the decoder looks at nothing behind
// them.
std::vector<std::uint8_t> with_checksums(std::span<const std::uint8_t> bytes) {
  std::vector<std::uint8_t> png(bytes.begin(), bytes.end());
  for (std::size_t at = 8; at + 12 <= png.size();) {
    const std::size_t length = big_endian(&png[at]);
    if (length > png.size() - at - 12) break;
    const std::uint32_t crc = crc_of({&png[at + 4], length + 4});
    for (unsigned i = 0; i < 4; ++i)
      png[at + 8 + length + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
    at += 12 + length;
  }
  return png;
}

void decode(std::span<const std::uint8_t> bytes) {
  Bracket bracket;
  try {
    bracket.exposures.push_back(daemon::decode_live_frame(bytes, "picture", 1U << 18));
  } catch (const daemon::SourceError&) {
    return;  // refused with a reason; anything else ends the program
  }
  daemon::FrameChecker({.bit_depth = 16}).check(bracket);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  decode({data, size});
  if (size > 8 && data[0] == 0x89) decode(with_checksums({data, size}));
  return 0;
}
