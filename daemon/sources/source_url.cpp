#include "daemon/sources/source_url.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

namespace lampglow::daemon {
namespace {

constexpr std::array<std::string_view, 9> kKinds = {
    "http://", "https://",   "mjpeg+http://", "mjpeg+https://", "rtsp://",
    "v4l2:",   "libcamera:", "watch:",        "archive:"};

bool holds_password(std::string_view url) {
  const std::size_t begin = url.find("://");
  if (begin == std::string_view::npos) return false;
  const std::string_view authority = url.substr(begin + 3, url.find_first_of("/?#", begin + 3) - begin - 3);
  return authority.find('@') != std::string_view::npos;
}

}  // namespace

std::string redacted_url(std::string_view url) {
  std::string text(url.substr(0, url.find_first_of("?#")));
  const std::size_t begin = text.find("://");
  if (begin == std::string::npos) return std::string(url);  // a device, a file
  const std::size_t end = std::min(text.find('/', begin + 3), text.size());
  if (end + 1 < text.size()) text = text.substr(0, end + 1) + "…";
  const std::size_t at = text.rfind('@', end);
  if (at != std::string::npos && at > begin) text.erase(begin + 3, at - begin - 2);
  return text;
}

std::string url_problem(std::string_view url) {
  if (holds_password(url))
    return "expected no user and password in the address; put USER:PASSWORD into a file and name it as "
           "credentials_file";
  for (const std::string_view kind : kKinds)
    if (url.starts_with(kind) && url.size() > kind.size()) return {};
  return fmt::format("expected {}", fmt::join(kKinds, ", "));
}

}  // namespace lampglow::daemon
