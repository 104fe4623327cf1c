#include "daemon/sources/http_mjpeg.h"

#include <fmt/format.h>

#include "daemon/sources/fault.h"
#include "daemon/sources/live_frame.h"

namespace lampglow::daemon {

using State = HttpTransfer::State;

HttpMjpeg::HttpMjpeg(SourceOptions options)
    : options_(std::move(options)), name_(redacted_url(options_.url)) {}

void HttpMjpeg::close() {
  parts_.reset();
  transfer_.reset();
}

void HttpMjpeg::need_reader() {
  if (parts_) return;
  const std::string boundary = multipart_boundary(transfer_->content_type());
  if (boundary.empty()) {
    throw SourceError(Fault::protocol_error,
                      fmt::format("{}: expected multipart/x-mixed-replace with a boundary, got '{}'", name_,
                                  transfer_->content_type()));
  }
  parts_ = std::make_unique<MultipartReader>(boundary, options_.max_bytes);
}

// What waited in the socket is as old as the last picture.
void HttpMjpeg::drop_stale() {
  const auto limit = std::chrono::steady_clock::now() + options_.connect_timeout;
  State state;
  do {
    state = transfer_->read_available();
    transfer_->bytes().clear();
  } while (state == State::more && std::chrono::steady_clock::now() < limit);
  if (parts_) parts_->skip();
}

// False when stopped.
bool HttpMjpeg::receive(Deadline deadline, std::stop_token stop) {
  const State state = transfer_->read(deadline, stop);
  if (state == State::stopped) return false;
  if (state == State::ended) throw SourceError(Fault::stream_ended, name_ + ": the camera ended the stream");
  need_reader();
  parts_->feed(transfer_->bytes());
  transfer_->bytes().clear();
  return true;
}

std::optional<std::vector<std::uint8_t>> HttpMjpeg::next_part(Deadline deadline, std::stop_token stop) {
  for (;;) {
    if (parts_) {
      if (auto part = parts_->take()) return part;
    }
    if (!receive(deadline, stop)) return std::nullopt;
  }
}

std::optional<Bracket> HttpMjpeg::next(std::stop_token stop) {
  try {
    auto bracket = take_picture(stop);
    if (!options_.stay_connected) close();
    return bracket;
  } catch (...) {
    close();  // what failed is not used again
    throw;
  }
}

std::optional<Bracket> HttpMjpeg::take_picture(std::stop_token stop) {
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  if (transfer_) {
    drop_stale();
  } else {
    transfer_ = std::make_unique<HttpTransfer>(options_, options_.url.substr(options_.url.find('+') + 1));
  }
  const auto part = next_part(deadline, stop);
  if (!part) return std::nullopt;
  Bracket bracket;
  bracket.time_utc = utc_now();
  bracket.exposures.push_back(decode_live_frame(*part, name_, options_.max_pixels));
  return bracket;
}

SourceInfo HttpMjpeg::describe(std::stop_token stop) {
  const auto deadline = std::chrono::steady_clock::now() + options_.frame_timeout;
  close();
  SourceInfo info;
  const auto bracket = next(stop);
  if (!bracket) return info;
  const auto& pixels = bracket->exposures.front().pixels;
  info.formats.push_back(fmt::format("MJPEG {}x{}", pixels.width_px, pixels.height_px));
  transfer_ = std::make_unique<HttpTransfer>(options_, options_.url.substr(options_.url.find('+') + 1));
  if (receive(deadline, stop)) info.driver = "HTTP, server " + transfer_->server();
  close();
  info.notes.push_back("A stream does not tell exposure and gain: lock both in the camera's own pages.");
  return info;
}

}  // namespace lampglow::daemon
