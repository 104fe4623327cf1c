#include "daemon/sources/http_snapshot.h"

#include <fmt/format.h>

#include "daemon/sources/fault.h"
#include "daemon/sources/http_transfer.h"
#include "daemon/sources/live_frame.h"

namespace lampglow::daemon {

HttpSnapshot::HttpSnapshot(SourceOptions options)
    : options_(std::move(options)), name_(redacted_url(options_.url)) {}

std::optional<Bracket> HttpSnapshot::next(std::stop_token stop) {
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  Bracket bracket;
  bracket.time_utc = utc_now();
  HttpTransfer transfer(options_, options_.url);
  HttpTransfer::State state;
  do {
    state = transfer.read(deadline, stop);
  } while (state == HttpTransfer::State::more);
  if (state == HttpTransfer::State::stopped) return std::nullopt;
  server_ = transfer.server();
  bracket.exposures.push_back(decode_live_frame(transfer.bytes(), name_, options_.max_pixels));
  return bracket;
}

SourceInfo HttpSnapshot::describe(std::stop_token stop) {
  const auto bracket = next(stop);
  SourceInfo info;
  info.driver = "HTTP" + (server_.empty() ? "" : ", server " + server_);
  if (bracket) {
    const auto& pixels = bracket->exposures.front().pixels;
    info.formats.push_back(fmt::format("picture {}x{}", pixels.width_px, pixels.height_px));
  }
  info.notes.push_back("A snapshot does not tell exposure and gain: lock both in the camera's own pages.");
  return info;
}

}  // namespace lampglow::daemon
