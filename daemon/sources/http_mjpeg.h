// Motion JPEG over HTTP: a multipart/x-mixed-replace answer that never ends.
#pragma once

#include <memory>

#include "daemon/sources/http_transfer.h"
#include "daemon/sources/multipart.h"
#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

class HttpMjpeg : public FrameSource {
 public:
  explicit HttpMjpeg(SourceOptions options);
  std::string name() const override { return name_; }

  // Connects, takes the first whole picture and disconnects; or, with stay_connected, drops what came since
  // the last picture and takes the next whole one.
  std::optional<Bracket> next(std::stop_token stop) override;
  void close() override;
  SourceInfo describe(std::stop_token stop) override;

 private:
  using Deadline = HttpTransfer::Deadline;
  std::optional<Bracket> take_picture(std::stop_token stop);
  void drop_stale();
  bool receive(Deadline deadline, std::stop_token stop);
  std::optional<std::vector<std::uint8_t>> next_part(Deadline deadline, std::stop_token stop);
  void need_reader();

  const SourceOptions options_;
  const std::string name_;
  std::unique_ptr<HttpTransfer> transfer_;
  std::unique_ptr<MultipartReader> parts_;  // from the answer's first bytes on
};

}  // namespace lampglow::daemon
