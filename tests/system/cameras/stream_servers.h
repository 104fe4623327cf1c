// ffmpeg and gst-rtsp-server as cameras that stream a few pictures over and over.
#pragma once

#include "tests/system/cameras/support.h"

namespace lampglow::testing {

// ffmpeg serving the pictures of a folder as multipart/x-mixed-replace to one client after another.
class MjpegServer {
 public:
  static bool available() { return !find_program("ffmpeg").empty(); }
  // `pattern`: "FOLDER/frame%d.jpg"; `encoder`: "copy", or "mjpeg -q:v 2".
  MjpegServer(const fs::path& folder, const std::string& pattern, const std::string& encoder,
              int frames_per_s);
  ~MjpegServer();
  MjpegServer(const MjpegServer&) = delete;
  MjpegServer& operator=(const MjpegServer&) = delete;
  int port() const { return port_; }

 private:
  int port_ = free_port();
  std::unique_ptr<Program> program_;
};

// Is there all that RtspServer and record_movie need?
bool rtsp_available();

// The pictures of `pattern` (full range, without B frames), over and over, as the movie `file`. `encoder`:
// "-c:v libx264 -qp 0 -g 5". Fails the test if ffmpeg does.
void record_movie(const std::string& pattern, const std::string& encoder, int frames_per_s, int repeats,
                  const fs::path& file);

// gst-rtsp-server with a recorded movie at rtsp://127.0.0.1:PORT/camera.
class RtspServer {
 public:
  // codec: h264 or h265. `account`: empty, or user and password, asked for by digest.
  RtspServer(const fs::path& folder, const fs::path& movie, const std::string& codec, int port,
             const std::vector<std::string>& account = {});
  void kill() { program_.kill(); }

 private:
  Program program_;
};

}  // namespace lampglow::testing
