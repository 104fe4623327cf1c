#include "daemon/sources/open_source.h"

#include <fmt/format.h>

#include <filesystem>

#include "daemon/config/site_file.h"
#include "daemon/errors.h"
#include "daemon/sources/archive.h"
#include "daemon/sources/http_mjpeg.h"
#include "daemon/sources/http_snapshot.h"
#include "daemon/sources/libcamera_camera.h"
#include "daemon/sources/rtsp_camera.h"
#include "daemon/sources/v4l2_camera.h"
#include "daemon/sources/watch_folder.h"

namespace lampglow::daemon {
namespace {

std::unique_ptr<FrameSource> open_archive(const std::string& path) {
  const Site site = read_site_file(std::filesystem::path(path) / "site.toml");
  return std::make_unique<ArchiveSource>(path, site.camera);
}

}  // namespace

TimePoint utc_now() {
  return std::chrono::floor<std::chrono::milliseconds>(std::chrono::system_clock::now());
}

std::unique_ptr<FrameSource> open_source(const SourceOptions& options) {
  const std::string& url = options.url;
  const auto is = [&](std::string_view kind) { return url.starts_with(kind); };
  if (const std::string problem = url_problem(url); !problem.empty())
    throw ConfigError(fmt::format("source '{}': {}", redacted_url(url), problem));
  if (is("http://") || is("https://")) return std::make_unique<HttpSnapshot>(options);
  if (is("mjpeg+http://") || is("mjpeg+https://")) return std::make_unique<HttpMjpeg>(options);
  if (is("rtsp://")) return std::make_unique<RtspCamera>(options);
  if (is("v4l2:")) return std::make_unique<V4l2Camera>(options);
  if (is("libcamera:")) return open_libcamera(options);
  if (is("watch:")) return std::make_unique<WatchFolder>(options);
  if (is("archive:")) return open_archive(url.substr(8));
  throw ConfigError(fmt::format("source '{}': this build can't open its kind", redacted_url(url)));
}

}  // namespace lampglow::daemon
