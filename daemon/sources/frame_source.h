// Where frames come from. Archives, simulated and real cameras are all alike behind this.
#pragma once

#include <optional>
#include <stop_token>
#include <string>

#include "estimator/photometry/exposure.h"

namespace lampglow::daemon {

class FrameSource {
 public:
  FrameSource() = default;
  FrameSource(const FrameSource&) = delete;
  FrameSource& operator=(const FrameSource&) = delete;
  virtual ~FrameSource() = default;

  // For messages; never holds a password.
  virtual std::string name() const = 0;

  // The next bracket; empty when there will be no more (an archive ends, a camera does not) or when stopped.
  // A frame that failed is a bracket with flags and a fault, so that every slot has a record.
  virtual std::optional<Bracket> next(std::stop_token stop) = 0;
};

}  // namespace lampglow::daemon
