// The event stream's last messages, so that a client that comes back gets what it missed.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/observation.h"

namespace lampglow::web {

// Where a client of the event stream is: the id of the last message it saw, RUN-SEQUENCE-TIME_MS.
struct StreamPosition {
  std::string run;
  std::uint64_t sequence = 0;
  TimePoint time_utc{};  // of the observation or event
};
// Empty if `id` is none of ours.
std::optional<StreamPosition> parse_stream_id(std::string_view id);

struct StreamMessage {
  std::uint64_t sequence = 0;  // ascending from 1 within one run of the program
  std::string wire;            // the whole message as sent: id, event, data
};

// Not for several threads at once.
class MessageLog {
 public:
  explicit MessageLog(int most);

  // `data`: one line.
  void add(const std::string& type, TimePoint time_utc, const std::string& data);
  // Messages with sequence > after; empty optional if some of them are no longer kept, or were never sent.
  std::optional<std::vector<std::shared_ptr<const StreamMessage>>> after(std::uint64_t after) const;
  std::uint64_t last_sequence() const { return sequence_; }
  // Goes into every message's id, so that a client of an earlier run is seen as such.
  const std::string& run_id() const { return run_id_; }

 private:
  int most_;
  std::string run_id_;
  std::uint64_t sequence_ = 0;
  std::deque<std::shared_ptr<const StreamMessage>> kept_;
};

}  // namespace lampglow::web
