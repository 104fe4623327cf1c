#include "estimator/observation_csv.h"

#include <charconv>

namespace lampglow {
namespace {

// std::to_chars knows no locale.
std::string number(const std::optional<double>& value) {
  if (!value) return "";
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, *value, std::chars_format::general, 6).ptr;
  return {text, end};
}

}  // namespace

std::string format_observation_csv(const Observation& observation) {
  std::string line = format_time_utc(observation.time_utc);
  const auto add = [&line](std::string_view field) {
    line += ',';
    line += field;
  };
  add(number(observation.mor_m()));
  add(number(observation.mor_low_m()));
  add(number(observation.mor_high_m()));
  add(to_string(observation.limit));
  add(number(observation.extinction_per_m));
  add(number(observation.q));
  add(number(observation.q_low));
  add(number(observation.q_high));
  add(to_string(observation.weather));
  add(to_string(observation.method));
  add(std::to_string(observation.lights_used));
  add(observation.quality.to_string());
  return line;
}

}  // namespace lampglow
