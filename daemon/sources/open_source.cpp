#include "daemon/sources/open_source.h"

#include <fmt/format.h>

#include <filesystem>

#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/sources/archive.h"
#include "daemon/sources/http_mjpeg.h"
#include "daemon/sources/http_snapshot.h"
#include "daemon/sources/rtsp_camera.h"
#include "daemon/sources/v4l2_camera.h"
#include "daemon/sources/watch_folder.h"

namespace lampglow::daemon {
namespace {

constexpr std::string_view kKinds =
    "http://, https://, mjpeg+http://, mjpeg+https://, rtsp://, v4l2:, libcamera:, watch: or archive:";

bool holds_password(std::string_view url) {
  const std::size_t begin = url.find("://");
  if (begin == std::string_view::npos) return false;
  const std::string_view authority = url.substr(begin + 3, url.find_first_of("/?#", begin + 3) - begin - 3);
  return authority.find('@') != std::string_view::npos;
}

std::unique_ptr<FrameSource> open_archive(const std::string& path) {
  const Site site = read_site_file(std::filesystem::path(path) / "site.toml");
  return std::make_unique<ArchiveSource>(path, site.camera);
}

}  // namespace

TimePoint utc_now() {
  return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
}

std::string redacted_url(std::string_view url) {
  std::string text(url.substr(0, url.find_first_of("?#")));
  const std::size_t begin = text.find("://");
  if (begin == std::string::npos) return std::string(url);  // a device, a file
  const std::size_t end = std::min(text.find('/', begin + 3), text.size());
  const std::size_t at = text.rfind('@', end);
  if (at != std::string::npos && at > begin) text.erase(begin + 3, at - begin - 2);
  return text;
}

std::unique_ptr<FrameSource> open_source(const SourceOptions& options) {
  const std::string& url = options.url;
  const auto is = [&](std::string_view scheme) {
    return url.starts_with(scheme) && url.size() > scheme.size();
  };
  if (holds_password(url)) {
    throw ConfigError(
        fmt::format("source '{}': expected no user and password in the address; put USER:PASSWORD "
                    "into a file and name it as credentials_file",
                    redacted_url(url)));
  }
  if (is("http://") || is("https://")) return std::make_unique<HttpSnapshot>(options);
  if (is("mjpeg+http://") || is("mjpeg+https://")) return std::make_unique<HttpMjpeg>(options);
  if (is("rtsp://")) return std::make_unique<RtspCamera>(options);
  if (is("v4l2:")) return std::make_unique<V4l2Camera>(options);
  if (is("watch:")) return std::make_unique<WatchFolder>(options);
  if (is("archive:")) return open_archive(url.substr(8));
  throw ConfigError(fmt::format("source '{}': expected {}", redacted_url(url), kKinds));
}

}  // namespace lampglow::daemon
