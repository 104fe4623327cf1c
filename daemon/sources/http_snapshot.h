// One picture per HTTP request.
#pragma once

#include "daemon/sources/open_source.h"

namespace lampglow::daemon {

class HttpSnapshot : public FrameSource {
 public:
  explicit HttpSnapshot(SourceOptions options);
  std::string name() const override { return name_; }
  std::optional<Bracket> next(std::stop_token stop) override;
  SourceInfo describe(std::stop_token stop) override;

 private:
  const SourceOptions options_;
  const std::string name_;
  std::string server_;
};

}  // namespace lampglow::daemon
