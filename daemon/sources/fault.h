// The one registry of what can go wrong with a camera: the single source for the log, storage and metrics. A
// fault's number and name never change their meaning; new ones are added at the end.
#pragma once

#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "estimator/quality.h"

namespace lampglow::daemon {

enum class Fault : int {
  none = 0,
  // The way to the camera.
  name_not_found = 1,
  connection_refused = 2,
  unreachable = 3,
  connect_timeout = 4,
  connection_lost = 5,
  stalled = 6,
  too_slow = 7,
  unauthorised = 8,
  no_credentials = 9,
  http_error = 10,
  redirect_loop = 11,
  too_large = 12,
  tls_expired = 13,
  tls_untrusted = 14,
  tls_error = 15,
  protocol_error = 16,
  stream_ended = 17,
  no_key_frame = 18,
  // The device.
  device_missing = 20,
  device_unplugged = 21,
  device_busy = 22,
  device_denied = 23,
  device_timeout = 24,
  device_error = 25,
  format_unsupported = 26,
  not_locked = 27,
  // The picture.
  not_an_image = 30,
  torn = 31,
  undecodable = 32,
  grey = 33,
  black = 34,
  frozen = 35,
  resolution_changed = 36,
  wrong_size = 37,
  file_unreadable = 38,
  no_new_file = 39,
  // The station.
  clock_stepped = 40,
  clock_unsynchronised = 41,
  slot_missed = 42,
  stopped = 43,
  internal = 44,
};

struct FaultInfo {
  Fault fault;
  std::string_view name;           // in log, database and the metrics' label `reason`
  std::string_view meaning;        // one sentence, with what a person can do about it
  std::optional<Quality> quality;  // the flag that a frame with this fault carries
};

// All faults, in the order of their numbers, `none` included.
std::span<const FaultInfo> fault_registry();
const FaultInfo& fault_info(Fault fault);
std::string_view to_string(Fault fault);
std::optional<Fault> parse_fault(std::string_view name);

// What a live source throws. The message names the source without its password and says what happened.
class SourceError : public std::runtime_error {
 public:
  SourceError(Fault fault, const std::string& message) : std::runtime_error(message), fault_(fault) {}
  Fault fault() const { return fault_; }

 private:
  Fault fault_;
};

}  // namespace lampglow::daemon
