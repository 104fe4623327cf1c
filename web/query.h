// The part of a URL behind the question mark, parsed strictly: what nobody knows is refused.
#pragma once

#include <map>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>

#include "estimator/time.h"

namespace lampglow::web {

// A request that cannot be understood; the message says which parameter and what was expected.
struct BadRequest : std::runtime_error {
  using std::runtime_error::runtime_error;
};

struct Target {
  std::string path;  // decoded, absolute, without ".." or empty segments
  std::map<std::string, std::string> query;
};

// Throws BadRequest for what is no origin-form target, for broken percent-encoding, control characters, and a
// parameter that comes twice.
Target parse_target(std::string_view target);

class Query {
 public:
  // Throws BadRequest if there is a parameter that is not among `known`.
  Query(const Target& target, std::span<const std::string_view> known);

  std::string text(std::string_view name) const;  // empty if absent
  std::optional<TimePoint> time(std::string_view name) const;
  std::optional<std::int64_t> integer(std::string_view name, std::int64_t low, std::int64_t high) const;
  bool boolean(std::string_view name) const;  // "true" or "false"; false if absent
  // One of the choices; the first if absent.
  std::string one_of(std::string_view name, std::span<const std::string_view> choices) const;

 private:
  const std::map<std::string, std::string>& values_;
};

std::string percent_encode(std::string_view text);

}  // namespace lampglow::web
