// The event stream's last messages, so that a client that comes back gets what it missed.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>

#include "estimator/observation.h"
#include "web/shapes.h"

namespace lampglow::web {

// Where a client of the event stream is: the id of the last message it saw, RUN-SEQUENCE-TIME_MS.
struct StreamPosition {
  std::string run;
  std::uint64_t sequence = 0;
  TimePoint time_utc{};  // of the observation or event
};
// Empty if `id` is none of ours.
std::optional<StreamPosition> parse_stream_id(std::string_view id);

// Messages as they are sent: id, event, data.
struct StreamText {
  std::string text;
  std::uint64_t last_sequence = 0;
};

// Not for several threads at once.
class MessageLog {
 public:
  // `stale_after`: an observation that is older when it is sent is no longer the current one.
  MessageLog(int most, std::chrono::seconds stale_after);

  void add_event(TimePoint time_utc, const std::string& json);
  // `current` gets its age when it is sent; `past` (a Feature without one) is sent instead once it is stale.
  void add_observation(TimePoint time_utc, FeatureHalves current, std::string past);
  // Messages with sequence > after, as of `now`; empty optional if some of them are no longer kept, or were
  // never sent.
  std::optional<StreamText> after(std::uint64_t after, TimePoint now) const;
  std::uint64_t last_sequence() const { return sequence_; }
  // Goes into every message's id, so that a client of an earlier run is seen as such.
  const std::string& run_id() const { return run_id_; }

 private:
  struct Message {
    std::uint64_t sequence = 0;  // ascending from 1 within one run of the program
    std::string_view type;
    TimePoint time_utc{};
    FeatureHalves current;  // empty for an event
    std::string data;
  };
  void add(Message message);
  void append(std::string& text, const Message& message, TimePoint now) const;

  int most_;
  std::chrono::seconds stale_after_;
  std::string run_id_;
  std::uint64_t sequence_ = 0;
  std::deque<Message> kept_;
};

}  // namespace lampglow::web
