// The parts of a multipart/x-mixed-replace stream (RFC 2046, as cameras write it).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace lampglow::daemon {

// The boundary of a Content-Type, without quotes and leading dashes; empty if it is no multipart type.
std::string multipart_boundary(std::string_view content_type);

class MultipartReader {
 public:
  // max_bytes: of one part's body.
  MultipartReader(std::string boundary, std::size_t max_bytes);

  // Throws SourceError(too_large) if a part grows beyond the limit, protocol_error if its headers do.
  void feed(std::span<const std::uint8_t> bytes);

  // The oldest whole part's body; empty if there is none yet. With a Content-Length in its headers a part is
  // whole as soon as so many bytes are there, else when the next boundary is.
  std::optional<std::vector<std::uint8_t>> take();

  // Forgets what is there, the part under way included: the next part is one that begins from now on.
  void skip();

 private:
  bool find_part();
  std::optional<std::size_t> body_end() const;
  std::size_t find(std::string_view text, std::size_t from) const;
  void drop(std::size_t count);

  const std::string delimiter_;  // "--boundary"
  const std::size_t max_bytes_;
  std::vector<std::uint8_t> buffer_;
  bool in_body_ = false;  // the buffer begins with a part's body
  std::optional<std::size_t> length_;
  mutable std::size_t searched_ = 0;  // no boundary begins before here
};

}  // namespace lampglow::daemon
