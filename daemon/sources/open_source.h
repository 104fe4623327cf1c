// From a URL-like setting to a frame source.
#pragma once

#include <chrono>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/sources/frame_source.h"
#include "daemon/sources/source_url.h"

namespace lampglow::daemon {

// How one camera is reached. The same settings stand in the configuration's [camera.source] table.
struct SourceOptions {
  // http(s)://HOST/snapshot.jpg       one picture per request
  // mjpeg+http(s)://HOST/stream       multipart/x-mixed-replace stream of JPEGs
  // rtsp://HOST/stream                H.264, H.265 or MJPEG over RTP over TCP
  // v4l2:/dev/v4l/by-path/...         a Video4Linux device
  // libcamera:ID                      a camera by its name in libcamera (`lampglow probe libcamera:` lists
  // them) watch:DIRECTORY                   pictures that another program puts there archive:PATH a recorded
  // archive (archive-format.md) A user and password in it are refused: they belong into credentials_file.
  std::string url;

  // A file with one line USER:PASSWORD (the password may hold any characters). A name without a slash is
  // looked up in $CREDENTIALS_DIRECTORY (systemd's LoadCredential). Read at every connection.
  std::string credentials_file;
  std::string ca_file;  // PEM of the CA that signed the camera's certificate; empty: the system's

  std::chrono::milliseconds connect_timeout{5'000};
  std::chrono::milliseconds frame_timeout{20'000};  // from the request to the whole bracket
  std::chrono::milliseconds stall_timeout{5'000};   // nothing at all received for so long
  int min_bytes_per_s = 1'000;                      // slower than this over stall_timeout is too_slow
  std::size_t max_bytes = 64u << 20;                // of one encoded picture
  std::size_t max_pixels = 64u << 20;               // of one decoded picture
  int max_redirects = 3;

  bool stay_connected = false;  // streams: keep the connection between pictures
  std::string pixel_format;  // FourCC wanted of v4l2, e.g. "Y12 ", or libcamera's name; empty: the best for
                             // photometry
  int width_px = 0;          // v4l2, libcamera: size wanted; 0: the largest
  int height_px = 0;
  std::vector<ExposureSetting> bracket;      // to begin with; empty: one exposure as the camera stands
  std::optional<int> gain_step{};            // v4l2: the gain control's value; empty: its minimum
  std::optional<double> gain_db_per_step{};  // v4l2: where the sensor's data sheet says so
  std::optional<double> exposure_unit_s{};   // v4l2: of V4L2_CID_EXPOSURE where there is no absolute control
};

// Throws ConfigError (exit 78) if the URL is of no known kind, holds a password, or names a source that this
// build does not have. Does not connect: a camera may be away when the daemon starts.
std::unique_ptr<FrameSource> open_source(const SourceOptions& options);

// Now, to the millisecond.
TimePoint utc_now();

}  // namespace lampglow::daemon
