// The flat lists: JSON entries and CSV lines, put together without a tree of values, for there may be many.
#include <charconv>
#include <cmath>

#include "web/json_parts.h"
#include "web/shapes.h"

namespace lampglow::web {
namespace {

std::string csv(const std::optional<double>& value) {
  if (!value) return "";
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, *value).ptr;
  return {text, end};
}

void append_number(std::string& out, const std::optional<double>& value) {
  value ? append_json_number(out, *value) : void(out += "null");
}

// RFC 4180.
std::string csv(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

}  // namespace

void append_observation_json(std::string& out, const storage::ObservationRow& row) {
  const Observation& o = row.observation;
  const auto field = [&out](const char* name, const std::optional<double>& value) {
    ((out += ",\"") += name) += "\":";
    append_number(out, value);
  };
  const auto word = [&out](const char* name, std::string_view value) {
    ((out += ",\"") += name) += "\":";
    value.empty() ? out += "null" : ((out += '"') += value) += '"';
  };
  ((out += "{\"time_utc\":\"") += format_time_utc(o.time_utc)) += '"';
  field("mor_m", o.mor_m());
  field("mor_low_m", o.mor_low_m());
  field("mor_high_m", o.mor_high_m());
  word("limit", to_string(o.limit));
  field("extinction_per_m", o.extinction_per_m);
  field("q", o.q);
  field("q_low", o.q_low);
  field("q_high", o.q_high);
  word("weather", to_string(o.weather));
  word("method", to_string(o.method));
  field("lights_used", o.lights_used);
  word("quality", o.quality.to_string());
  field("period_s", row.period_s);
  field("frames", row.frames);
  field("values", row.values);
  if (!row.reason.empty()) out += ",\"reason\":" + json_string(row.reason);
  out += '}';
}

std::string observation_csv_header() {
  return "time_utc,mor_m,mor_low_m,mor_high_m,limit,extinction_per_m,q,q_low,q_high,weather,method,lights_"
         "used,"
         "quality,camera,period_s,frames,values\r\n";
}

std::string observation_csv(const storage::CameraRecord& camera, const storage::ObservationRow& row) {
  const Observation& o = row.observation;
  std::string out = format_time_utc(o.time_utc);
  for (const auto& value : {o.mor_m(), o.mor_low_m(), o.mor_high_m()}) out += "," + csv(value);
  out += "," + std::string(to_string(o.limit));
  for (const auto& value : {o.extinction_per_m, o.q, o.q_low, o.q_high}) out += "," + csv(value);
  out += "," + std::string(to_string(o.weather)) + "," + std::string(to_string(o.method)) + "," +
         std::to_string(o.lights_used) + "," + o.quality.to_string() + "," + csv(camera.name) + "," +
         std::to_string(row.period_s) + "," + std::to_string(row.frames) + "," + std::to_string(row.values);
  return out + "\r\n";
}

}  // namespace lampglow::web
