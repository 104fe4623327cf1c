// One HTTP GET by libcurl, fed out in pieces, with every limit that a live camera needs: connect, stall,
// rate, total time, redirects. For the snapshot and the MJPEG source.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

class HttpTransfer {
 public:
  using Deadline = std::chrono::steady_clock::time_point;
  enum class State { more, ended, stopped, waiting };

  // `url` is http:// or https://. Reads the credentials now. Throws SourceError.
  HttpTransfer(const SourceOptions& options, const std::string& url);
  HttpTransfer(const HttpTransfer&) = delete;
  HttpTransfer& operator=(const HttpTransfer&) = delete;
  ~HttpTransfer();

  // Waits until more bytes came (more), the answer is complete (ended) or a stop is asked for (stopped).
  // Throws SourceError with the reason where the answer is an error, stalls, trickles or passes the deadline.
  State read(Deadline deadline, std::stop_token stop);

  // What can be read at once, without waiting: more, ended or waiting.
  State read_available();

  // All bytes read and not yet taken.
  std::vector<std::uint8_t>& bytes();
  std::string content_type() const;
  std::string server() const;  // as the server names itself

 private:
  class Curl;
  std::unique_ptr<Curl> curl_;
};

}  // namespace lampglow::daemon
