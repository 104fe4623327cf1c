#include "estimator/time.h"

#include <cstdio>

namespace lampglow {
namespace {

// A field of exactly `width` digits at `at`; empty if there is anything but digits.
std::optional<int> digits(std::string_view text, size_t at, size_t width) {
  if (at + width > text.size()) return std::nullopt;
  int value = 0;
  const char* first = text.data() + at;
  for (size_t i = 0; i < width; ++i) {
    if (first[i] < '0' || first[i] > '9') return std::nullopt;
    value = value * 10 + (first[i] - '0');
  }
  return value;
}

// ".25Z" -> 250; "Z" -> 0.
std::optional<int> fraction_ms(std::string_view tail) {
  if (tail == "Z") return 0;
  if (tail.size() < 3 || tail.size() > 5 || tail.front() != '.' || tail.back() != 'Z') return std::nullopt;
  const size_t count = tail.size() - 2;
  const auto value = digits(tail, 1, count);
  if (!value) return std::nullopt;
  return *value * (count == 1 ? 100 : count == 2 ? 10 : 1);
}

}  // namespace

std::optional<TimePoint> parse_time_utc(std::string_view text) {
  using namespace std::chrono;
  if (text.size() < 20 || text[4] != '-' || text[7] != '-' || text[10] != 'T' || text[13] != ':' ||
      text[16] != ':')
    return std::nullopt;
  const auto y = digits(text, 0, 4), mo = digits(text, 5, 2), d = digits(text, 8, 2);
  const auto h = digits(text, 11, 2), mi = digits(text, 14, 2), s = digits(text, 17, 2);
  const auto ms = fraction_ms(text.substr(19));
  if (!y || !mo || !d || !h || !mi || !s || !ms) return std::nullopt;
  const year_month_day date{year{*y}, month{static_cast<unsigned>(*mo)}, day{static_cast<unsigned>(*d)}};
  if (!date.ok() || *h > 23 || *mi > 59 || *s > 59) return std::nullopt;
  return TimePoint{sys_days{date}} + hours{*h} + minutes{*mi} + seconds{*s} + milliseconds{*ms};
}

std::string format_time_utc(TimePoint time) {
  using namespace std::chrono;
  const auto day_start = floor<days>(time);
  const year_month_day date{day_start};
  const hh_mm_ss clock{time - day_start};
  char text[40];
  std::snprintf(text, sizeof text, "%04d-%02u-%02uT%02d:%02d:%02d", static_cast<int>(date.year()),
                static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                static_cast<int>(clock.hours().count()), static_cast<int>(clock.minutes().count()),
                static_cast<int>(clock.seconds().count()));
  std::string out = text;
  if (const auto ms = clock.subseconds().count(); ms != 0) {
    std::snprintf(text, sizeof text, ".%03d", static_cast<int>(ms));
    out += text;
  }
  return out + "Z";
}

}  // namespace lampglow
