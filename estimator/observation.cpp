#include "estimator/observation.h"

namespace lampglow {
namespace {

std::optional<double> mor_of(const std::optional<double>& extinction_per_m) {
  if (!extinction_per_m || !(*extinction_per_m > 0)) return std::nullopt;
  return kMorTimesExtinction / *extinction_per_m;
}

}  // namespace

std::string_view to_string(Limit value) {
  switch (value) {
    case Limit::above:
      return "above";
    case Limit::below:
      return "below";
    case Limit::none:
      break;
  }
  return "";
}

std::string_view to_string(Method value) {
  switch (value) {
    case Method::glow:
      return "glow";
    case Method::contrast:
      return "contrast";
    case Method::none:
      break;
  }
  return "none";
}

std::string_view to_string(Weather value) {
  switch (value) {
    case Weather::clear:
      return "clear";
    case Weather::haze:
      return "haze";
    case Weather::mist:
      return "mist";
    case Weather::fog:
      return "fog";
    case Weather::rain:
      return "rain";
    case Weather::unknown:
      break;
  }
  return "unknown";
}

std::string_view to_string(LampState value) {
  switch (value) {
    case LampState::seen:
      return "seen";
    case LampState::faded:
      return "faded";
    case LampState::off:
      return "off";
    case LampState::hidden:
      return "hidden";
    case LampState::saturated:
      return "saturated";
    case LampState::unknown:
      break;
  }
  return "unknown";
}

std::optional<Weather> parse_weather(std::string_view text) {
  for (const Weather weather :
       {Weather::unknown, Weather::clear, Weather::haze, Weather::mist, Weather::fog, Weather::rain})
    if (text == to_string(weather)) return weather;
  return std::nullopt;
}

std::optional<double> Observation::mor_m() const {
  return mor_of(extinction_per_m);
}
std::optional<double> Observation::mor_low_m() const {
  return mor_of(extinction_high_per_m);
}
std::optional<double> Observation::mor_high_m() const {
  return mor_of(extinction_low_per_m);
}

}  // namespace lampglow
