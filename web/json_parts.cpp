#include "web/json_parts.h"

#include <charconv>
#include <cmath>

namespace lampglow::web {
namespace {

// Joins what `each` appends for every element by commas.
template <typename Range, typename Each>
void append_joined(std::string& out, const Range& range, const Each& each) {
  bool first = true;
  for (const auto& element : range) {
    if (!first) out += ',';
    first = false;
    each(element);
  }
}

void append_value(std::string& out, const json::value& value) {
  if (const auto* object = value.if_object()) {
    out += '{';
    append_joined(out, *object, [&out](const json::key_value_pair& entry) {
      (out += json::serialize(json::string(entry.key()))) += ':';
      append_value(out, entry.value());
    });
    out += '}';
  } else if (const auto* array = value.if_array()) {
    out += '[';
    append_joined(out, *array, [&out](const json::value& element) { append_value(out, element); });
    out += ']';
  } else if (const auto* number = value.if_double()) {
    append_json_number(out, *number);
  } else {
    out += json::serialize(value);
  }
}

}  // namespace

void append_json_number(std::string& out, double value) {
  char text[40];
  if (!std::isfinite(value))
    out += "null";
  else
    out.append(text, std::to_chars(text, text + sizeof text, value).ptr);
}

std::string json_text(const json::value& value) {
  std::string out;
  append_value(out, value);
  return out;
}

json::value number(const std::optional<double>& value) {
  return value ? json::value(*value) : json::value(nullptr);
}

json::value text_or_null(std::string_view text) {
  return text.empty() ? json::value(nullptr) : json::value(text);
}

json::value time_or_null(const std::optional<TimePoint>& time) {
  return time ? json::value(format_time_utc(*time)) : json::value(nullptr);
}

json::object quantity(const char* unit, const std::optional<double>& value, const std::optional<double>& low,
                      const std::optional<double>& high) {
  return {
      {"value", number(value)}, {"minValue", number(low)}, {"maxValue", number(high)}, {"unitCode", unit}};
}

json::value geometry(const storage::CameraRecord& camera) {
  if (!camera.latitude_deg || !camera.longitude_deg) return nullptr;
  json::array place{*camera.longitude_deg, *camera.latitude_deg};
  if (camera.elevation_m) place.emplace_back(*camera.elevation_m);
  return json::object{{"type", "Point"}, {"coordinates", place}};
}

json::object health_json(const CameraHealth& health) {
  return {{"up", health.up},
          {"fault", text_or_null(health.fault)},
          {"message", text_or_null(health.message)},
          {"lastFrame", time_or_null(health.last_frame_utc)},
          {"nextDue", time_or_null(health.next_due_utc)}};
}

}  // namespace lampglow::web
