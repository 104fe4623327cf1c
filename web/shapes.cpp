#include "web/shapes.h"

#include "web/json_parts.h"
#include "web/metar.h"

namespace lampglow::web {
namespace {

using storage::CameraRecord;
using storage::ObservationRow;

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
  content["staleAfterSeconds"] = parts.stale_after_s;
  content["oneMinute"] = mean_or_null(stale ? nullptr : parts.one_minute);
  content["tenMinutes"] = mean_or_null(stale ? nullptr : parts.ten_minutes);
  content["trend"] = stale ? json::value(nullptr) : text_or_null(parts.trend);
  content["sensor"] = health_json(parts.health);
  std::string text = json_text(feature(*parts.camera, row, std::move(content)));
  // "properties" is the last member: the age goes in as the last of its own.
  text.resize(text.size() - 2);
  return {text + ",\"ageSeconds\":", "}}"};
}

std::string observation_feature(const CameraRecord& camera, const ObservationRow& row) {
  return json_text(feature(camera, row, properties(camera, row)));
}

}  // namespace lampglow::web
