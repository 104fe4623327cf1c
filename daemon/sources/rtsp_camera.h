// RTSP by libavformat: over TCP always, every call under a monotonic deadline, nothing before a clean key
// frame.
#pragma once

#include <memory>

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

class RtspCamera : public FrameSource {
 public:
  explicit RtspCamera(SourceOptions options);
  ~RtspCamera() override;
  std::string name() const override { return name_; }

  // Connects, skips to the next key frame, decodes it and disconnects. With stay_connected the session stays;
  // the stream is then read and dropped up to the present before the next key frame is taken, so that a
  // picture is never older than the call.
  std::optional<Bracket> next(std::stop_token stop) override;
  void close() override;
  SourceInfo describe(std::stop_token stop) override;

 private:
  class Session;
  std::optional<Bracket> take_picture(std::stop_token stop);

  const SourceOptions options_;
  const std::string name_;
  std::unique_ptr<Session> session_;
};

}  // namespace lampglow::daemon
