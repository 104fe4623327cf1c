// Bytes as text, for pictures within an HTML file.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace lampglow::daemon {

// RFC 4648, with padding.
std::string base64(std::span<const std::uint8_t> bytes);

}  // namespace lampglow::daemon
