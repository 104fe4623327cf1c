#include "web/metar.h"

#include <chrono>
#include <cmath>
#include <cstdio>

namespace lampglow::web {
namespace {

int rounded_down(double mor_m) {
  const int whole = static_cast<int>(std::floor(mor_m + 1e-6));
  if (whole < 50) return 0;
  if (whole < 800) return whole / 50 * 50;
  if (whole < 5000) return whole / 100 * 100;
  if (whole < 10000) return whole / 1000 * 1000;
  return 9999;
}

std::string station_word(const std::string& station) {
  std::string word;
  for (const char c : station) {
    if (c >= 'a' && c <= 'z') word += static_cast<char>(c - 'a' + 'A');
    if ((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9')) word += c;
  }
  return word.empty() ? "////" : word;
}

}  // namespace

std::string metar_visibility(const Observation& observation) {
  const auto mor_m = observation.mor_m();
  if (!mor_m || (observation.limit == Limit::above && *mor_m < 10000)) return "////";
  if (observation.limit == Limit::below && *mor_m >= 50) return "////";
  char text[8];
  std::snprintf(text, sizeof text, "%04d", *mor_m >= 10000 ? 9999 : rounded_down(*mor_m));
  return text;
}

std::string metar_weather(const Observation& observation) {
  const auto mor_m = observation.mor_m();
  if (!mor_m || observation.limit == Limit::above) return observation.weather == Weather::rain ? "RA" : "";
  if (observation.weather == Weather::rain) return "RA";
  if (*mor_m >= 5000) return "";
  if (observation.weather == Weather::haze) return "HZ";
  if (*mor_m < 1000) return "FG";
  return observation.limit == Limit::below ? "" : "BR";
}

std::string metar_like(const std::string& station, const Observation& observation) {
  using namespace std::chrono;
  const auto day = floor<days>(observation.time_utc);
  const hh_mm_ss clock{floor<minutes>(observation.time_utc) - day};
  char time[16];
  std::snprintf(time, sizeof time, "%02u%02d%02dZ", static_cast<unsigned>(year_month_day{day}.day()) % 100,
                static_cast<int>(clock.hours().count()) % 100,
                static_cast<int>(clock.minutes().count()) % 100);
  const std::string weather = metar_weather(observation);
  return "METAR " + station_word(station) + " " + time + " AUTO /////KT " + metar_visibility(observation) +
         (weather.empty() ? "" : " " + weather);
}

}  // namespace lampglow::web
