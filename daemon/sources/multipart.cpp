#include "daemon/sources/multipart.h"

#include <strings.h>

#include <algorithm>
#include <charconv>

#include "daemon/sources/fault.h"

namespace lampglow::daemon {
namespace {

constexpr std::size_t kMaxHeaderBytes = 16 << 10;
constexpr std::size_t kNotFound = std::string_view::npos;

std::optional<std::size_t> content_length(std::string_view headers) {
  constexpr std::string_view kName = "content-length:";
  for (std::size_t line = 0; line < headers.size();) {
    const std::size_t end = std::min(headers.find('\n', line), headers.size());
    if (end - line > kName.size() && strncasecmp(headers.data() + line, kName.data(), kName.size()) == 0) {
      std::size_t at = line + kName.size();
      while (at < end && headers[at] == ' ') ++at;
      std::size_t value = 0;
      if (std::from_chars(headers.data() + at, headers.data() + end, value).ec == std::errc()) return value;
    }
    line = end + 1;
  }
  return std::nullopt;
}

}  // namespace

std::string multipart_boundary(std::string_view content_type) {
  constexpr std::string_view kKey = "boundary=";
  if (strncasecmp(content_type.data(), "multipart/", std::min<std::size_t>(10, content_type.size())) != 0)
    return "";
  const std::size_t at = content_type.find(kKey);
  if (at == kNotFound) return "";
  std::string_view boundary = content_type.substr(at + kKey.size());
  boundary = boundary.substr(0, boundary.find(';'));
  while (!boundary.empty() && (boundary.front() == '"' || boundary.front() == '-')) boundary.remove_prefix(1);
  while (!boundary.empty() && (boundary.back() == '"' || boundary.back() == ' ')) boundary.remove_suffix(1);
  return std::string(boundary);
}

MultipartReader::MultipartReader(std::string boundary, std::size_t max_bytes)
    : delimiter_("--" + std::move(boundary)), max_bytes_(max_bytes) {}

void MultipartReader::feed(std::span<const std::uint8_t> bytes) {
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

std::size_t MultipartReader::find(std::string_view text, std::size_t from) const {
  const std::string_view all(reinterpret_cast<const char*>(buffer_.data()), buffer_.size());
  return all.find(text, from);
}

void MultipartReader::drop(std::size_t count) {
  buffer_.erase(buffer_.begin(),
                buffer_.begin() + static_cast<std::ptrdiff_t>(std::min(count, buffer_.size())));
  searched_ = 0;
}

// Brings the buffer to the first byte of the next part's body.
bool MultipartReader::find_part() {
  const std::size_t at = find(delimiter_, 0);
  if (at == kNotFound) {
    if (buffer_.size() > delimiter_.size()) drop(buffer_.size() - delimiter_.size());
    return false;
  }
  drop(at);
  const std::size_t crlf = find("\r\n\r\n", 0), lf = find("\n\n", 0);
  const std::size_t end = std::min(crlf, lf);
  if (end == kNotFound) {
    if (buffer_.size() > kMaxHeaderBytes) {
      throw SourceError(Fault::protocol_error, "a part of the stream has headers without end");
    }
    return false;
  }
  length_ = content_length({reinterpret_cast<const char*>(buffer_.data()), end});
  drop(end + (end == crlf ? 4 : 2));
  in_body_ = true;
  return true;
}

std::optional<std::size_t> MultipartReader::body_end() const {
  if (length_) return buffer_.size() >= *length_ ? length_ : std::nullopt;
  std::size_t at = find(delimiter_, searched_);
  if (at == kNotFound) {
    searched_ = buffer_.size() - std::min(buffer_.size(), delimiter_.size());
    return std::nullopt;
  }
  if (at > 0 && buffer_[at - 1] == '\n') --at;
  if (at > 0 && buffer_[at - 1] == '\r') --at;
  return at;
}

std::optional<std::vector<std::uint8_t>> MultipartReader::take() {
  if (!in_body_ && !find_part()) return std::nullopt;
  const std::optional<std::size_t> end = body_end();
  if (end.value_or(buffer_.size()) > max_bytes_ || length_.value_or(0) > max_bytes_) {
    throw SourceError(Fault::too_large, "a picture of the stream is larger than allowed");
  }
  if (!end) return std::nullopt;
  std::vector<std::uint8_t> body(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(*end));
  drop(*end);
  in_body_ = false;
  return body;
}

void MultipartReader::skip() {
  drop(buffer_.size());
  in_body_ = false;
}

}  // namespace lampglow::daemon
