#include "web/shapes.h"

#include <boost/json.hpp>
#include <charconv>
#include <cmath>

#include "web/metar.h"

namespace lampglow::web {
namespace {

namespace json = boost::json;
using storage::CameraRecord;
using storage::ObservationRow;

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

std::optional<double> two_percent(const std::optional<double>& mor_m) {
  constexpr double ratio = kTwoPercentVisibilityTimesExtinction / kMorTimesExtinction;
  return mor_m ? std::optional<double>(*mor_m * ratio) : std::nullopt;
}

std::optional<double> percent(const std::optional<double>& fraction) {
  return fraction ? std::optional<double>(*fraction * 100) : std::nullopt;
}

json::object visibility(const Observation& o) {
  json::object out = quantity("wmoUnit:m", o.mor_m(), o.mor_low_m(), o.mor_high_m());
  out["limit"] = text_or_null(to_string(o.limit));
  return out;
}

json::array quality(const Observation& o) {
  json::array out;
  for (const QualityFlag& entry : quality_registry())
    if (o.quality.has(entry.flag)) out.emplace_back(entry.name);
  return out;
}

json::value probabilities(const Observation& o) {
  json::object out;
  double sum = 0;
  for (size_t i = 0; i < o.weather_probability.size(); ++i) {
    out[to_string(static_cast<Weather>(i))] = o.weather_probability[i];
    sum += o.weather_probability[i];
  }
  return sum > 0 ? json::value(std::move(out)) : json::value(nullptr);
}

json::array present_weather(const Observation& o) {
  const std::string code = metar_weather(o);
  if (code.empty()) return {};
  const char* name = code == "FG" ? "fog" : code == "BR" ? "mist" : code == "HZ" ? "haze" : "rain";
  return {
      json::object{{"intensity", nullptr}, {"modifier", nullptr}, {"weather", name}, {"rawString", code}}};
}

json::value geometry(const CameraRecord& camera) {
  if (!camera.latitude_deg || !camera.longitude_deg) return nullptr;
  json::array place{*camera.longitude_deg, *camera.latitude_deg};
  if (camera.elevation_m) place.emplace_back(*camera.elevation_m);
  return json::object{{"type", "Point"}, {"coordinates", place}};
}

json::object measured(const Observation& o) {
  return {
      {"visibility", visibility(o)},
      {"visibility2Percent", quantity("wmoUnit:m", two_percent(o.mor_m()), two_percent(o.mor_low_m()),
                                      two_percent(o.mor_high_m()))},
      {"extinction",
       quantity("wmoUnit:m-1", o.extinction_per_m, o.extinction_low_per_m, o.extinction_high_per_m)},
      {"forwardScattering", quantity("wmoUnit:1", o.q, o.q_low, o.q_high)},
      {"relativeHumidity",
       json::object{{"value", number(percent(o.relative_humidity))}, {"unitCode", "wmoUnit:percent"}}},
      {"weather", to_string(o.weather)},
      {"weatherProbability", probabilities(o)},
      {"lectureClass", o.lecture_class ? json::value(to_string(*o.lecture_class)) : json::value(nullptr)},
      {"presentWeather", present_weather(o)},
      {"wmo4680", o.wmo_4680 ? json::value(*o.wmo_4680) : json::value(nullptr)},
  };
}

json::object properties(const CameraRecord& camera, const ObservationRow& row) {
  const Observation& o = row.observation;
  json::object out{{"station", camera.station},
                   {"camera", camera.name},
                   {"timestamp", format_time_utc(o.time_utc)},
                   {"averagingPeriodSeconds", row.period_s},
                   {"frames", row.frames},
                   {"values", row.values},
                   {"visibilityDefinition", "MOR: 5 % contrast (WMO, CIE), 2.996/extinction"}};
  for (auto& entry : measured(o)) out[entry.key()] = std::move(entry.value());
  out["rawMessage"] = metar_like(camera.station, o);
  out["method"] = to_string(o.method);
  out["lightsUsed"] = o.lights_used;
  out["quality"] = quality(o);
  out["reason"] = text_or_null(row.reason);
  return out;
}

json::object feature(const CameraRecord& camera, const ObservationRow& row, json::object content) {
  return {{"type", "Feature"},
          {"id", observation_id(camera, row)},
          {"geometry", geometry(camera)},
          {"properties", std::move(content)}};
}

json::value mean_or_null(const ObservationRow* row) {
  if (!row || row->values == 0) return nullptr;
  json::object out{
      {"averagingPeriodSeconds", row->period_s}, {"frames", row->frames}, {"values", row->values}};
  out["visibility"] = visibility(row->observation);
  return out;
}

json::object health_json(const CameraHealth& health) {
  return {{"up", health.up},
          {"fault", text_or_null(health.fault)},
          {"message", text_or_null(health.message)},
          {"lastFrame", time_or_null(health.last_frame_utc)},
          {"nextDue", time_or_null(health.next_due_utc)}};
}

std::string csv(const std::optional<double>& value) {
  if (!value) return "";
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, *value).ptr;
  return {text, end};
}

void append_number(std::string& out, const std::optional<double>& value) {
  char text[40];
  if (!value || !std::isfinite(*value)) {
    out += "null";
    return;
  }
  out.append(text, std::to_chars(text, text + sizeof text, *value).ptr);
}

json::array numbers(const std::vector<double>& values) {
  return json::array(values.begin(), values.end());
}

// RFC 4180.
std::string csv(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}

}  // namespace

std::string observation_id(const CameraRecord& camera, const ObservationRow& row) {
  return camera.name + "/" + format_time_utc(row.observation.time_utc) +
         (row.period_s ? "/" + std::to_string(row.period_s) : "");
}

FeatureHalves current_feature(const CurrentParts& parts, bool stale) {
  ObservationRow row = *parts.latest;
  if (stale) {
    Observation empty;
    empty.time_utc = row.observation.time_utc;
    empty.quality = row.observation.quality;
    row.observation = empty;
    row.values = 0;
    row.reason = "stale: the last frame is too old to say what the air is like now";
  }
  json::object content = properties(*parts.camera, row);
  content["stale"] = stale;
  content["oneMinute"] = mean_or_null(stale ? nullptr : parts.one_minute);
  content["tenMinutes"] = mean_or_null(stale ? nullptr : parts.ten_minutes);
  content["trend"] = stale ? json::value(nullptr) : text_or_null(parts.trend);
  content["sensor"] = health_json(parts.health);
  std::string text = json::serialize(feature(*parts.camera, row, std::move(content)));
  // "properties" is the last member: the age goes in as the last of its own.
  text.resize(text.size() - 2);
  return {text + ",\"ageSeconds\":", "}}"};
}

std::string observation_feature(const CameraRecord& camera, const ObservationRow& row) {
  return json::serialize(feature(camera, row, properties(camera, row)));
}

void append_observation_json(std::string& out, const ObservationRow& row) {
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
  if (!row.reason.empty()) out += ",\"reason\":" + json::serialize(json::string(row.reason));
  out += '}';
}

std::string observation_csv_header() {
  return "time_utc,mor_m,mor_low_m,mor_high_m,limit,extinction_per_m,q,q_low,q_high,weather,method,lights_"
         "used,"
         "quality,camera,period_s,frames,values\r\n";
}

std::string observation_csv(const CameraRecord& camera, const ObservationRow& row) {
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

std::string light_json(const storage::LampRecord& lamp, const LampFit* fit,
                       std::optional<TimePoint> fit_time) {
  json::object out{{"id", lamp.id},
                   {"x", lamp.x_px},
                   {"y", lamp.y_px},
                   {"distance", quantity("wmoUnit:m", lamp.distance_m, {}, {})},
                   {"referenceSince", time_or_null(lamp.reference_since)},
                   {"state", fit ? to_string(fit->state) : to_string(LampState::unknown)},
                   {"fit", nullptr}};
  if (fit)
    out["fit"] = json::object{{"timestamp", time_or_null(fit_time)},
                              {"x", fit->x_px},
                              {"y", fit->y_px},
                              {"distanceMeters", number(fit->distance_m)},
                              {"strengthRatio", number(fit->strength_ratio)},
                              {"opticalThickness", number(fit->optical_thickness)},
                              {"residualRms", number(fit->residual_rms)}};
  return json::serialize(out);
}

std::string profile_json(const std::string& lamp, TimePoint time, const RingProfile& profile) {
  return json::serialize(json::object{
      {"id", lamp},
      {"timestamp", format_time_utc(time)},
      {"thetaDegrees", numbers(profile.theta_deg)},
      {"radiance", numbers(profile.radiance)},
      {"radianceSigma", numbers(profile.radiance_sigma)},
      {"model", profile.model.empty() ? json::value(nullptr) : json::value(numbers(profile.model))}});
}

std::string camera_json(const CameraRecord& camera, const CameraHealth& health,
                        const std::optional<TimePoint>& last_observation_utc) {
  return json::serialize(json::object{{"camera", camera.name},
                                      {"station", camera.station},
                                      {"geometry", geometry(camera)},
                                      {"width", camera.width_px},
                                      {"height", camera.height_px},
                                      {"lastObservation", time_or_null(last_observation_utc)},
                                      {"sensor", health_json(health)}});
}

std::string picture_json(const storage::PictureRecord& picture) {
  const std::string time = format_time_utc(picture.time_utc);
  return json::serialize(json::object{{"camera", picture.camera},
                                      {"time", time},
                                      {"keptFor", to_string(picture.kept_for)},
                                      {"bytes", picture.size_bytes},
                                      {"href", "/v1/frames/" + picture.camera + "/" + time + ".jpg"}});
}

std::string json_string(std::string_view text) {
  return json::serialize(json::string(text));
}

std::string event_json(const storage::Event& event) {
  return json::serialize(json::object{{"id", event.number},
                                      {"time", format_time_utc(event.time_utc)},
                                      {"kind", to_string(event.kind)},
                                      {"severity", to_string(event.severity)},
                                      {"camera", text_or_null(event.camera)},
                                      {"message", event.message}});
}

}  // namespace lampglow::web
