#include "tests/system/cameras/stream_servers.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>

namespace lampglow::testing {
namespace {

std::vector<std::string> rtsp_command(const fs::path& movie, const std::string& codec, int port,
                                      const std::vector<std::string>& account) {
  std::vector<std::string> command{"/usr/bin/python3",
                                   LAMPGLOW_SOURCE_DIR "/tests/system/cameras/rtsp_server.py",
                                   std::to_string(port), movie.string(), codec};
  command.insert(command.end(), account.begin(), account.end());
  return command;
}

}  // namespace

// ffmpeg's listening mode serves one client and ends; a shell starts it anew, as a camera's service would.
MjpegServer::MjpegServer(const fs::path& folder, const std::string& pattern, const std::string& encoder,
                         int frames_per_s) {
  write_file(folder / "serve.sh",
             fmt::format("while :; do {} -loglevel error -re -loop 1 -framerate {} -i '{}' -c:v {} "
                         "-f mpjpeg -content_type 'multipart/x-mixed-replace;boundary=ffmpeg' -listen 1 "
                         "http://127.0.0.1:{}/stream & child=$!; "
                         "trap 'kill -9 $child; exit' TERM; wait $child; done",
                         find_program("ffmpeg"), frames_per_s, pattern, encoder, port_));
  program_ = std::make_unique<Program>(std::vector<std::string>{"/bin/sh", (folder / "serve.sh").string()},
                                       folder / "ffmpeg.log");
}

MjpegServer::~MjpegServer() {
  program_->terminate();
}

bool rtsp_available() {
  return !find_program("ffmpeg").empty() &&
         std::system(
             "/usr/bin/python3 -c \"import gi; gi.require_version('GstRtspServer', '1.0'); "
             "from gi.repository import Gst; Gst.init(None); "
             "assert Gst.ElementFactory.find('rtph265pay') and Gst.ElementFactory.find('qtdemux')\" "
             ">/dev/null 2>&1") == 0;
}

void record_movie(const std::string& pattern, const std::string& encoder, int frames_per_s, int repeats,
                  const fs::path& file) {
  const std::string command = fmt::format(
      "{} -loglevel error -stream_loop {} -framerate {} -i '{}' -vf scale=out_range=full -pix_fmt yuvj420p "
      "-color_range pc {} -bf 0 -y {} >> {}.log 2>&1",
      find_program("ffmpeg"), repeats, frames_per_s, pattern, encoder, file.string(), file.string());
  ASSERT_EQ(std::system(command.c_str()), 0) << command;
}

RtspServer::RtspServer(const fs::path& folder, const fs::path& movie, const std::string& codec, int port,
                       const std::vector<std::string>& account)
    : program_(rtsp_command(movie, codec, port, account), folder / "rtsp.log") {
  wait_for_port(port);
}

}  // namespace lampglow::testing
