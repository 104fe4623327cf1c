// Lamps, ring profiles, cameras, kept pictures and events.
#include "web/json_parts.h"
#include "web/shapes.h"

namespace lampglow::web {

namespace {

json::array numbers(const std::vector<double>& values) {
  return json::array(values.begin(), values.end());
}

}  // namespace

std::string light_json(const storage::LampRecord& lamp, const LampFit* fit, std::optional<TimePoint> fit_time,
                       bool current) {
  json::object out{{"id", lamp.id},
                   {"x", lamp.x_px},
                   {"y", lamp.y_px},
                   {"distance", quantity("wmoUnit:m", lamp.distance_m, {}, {})},
                   {"referenceSince", time_or_null(lamp.reference_since)},
                   {"state", fit && current ? to_string(fit->state) : to_string(LampState::unknown)},
                   {"fit", nullptr}};
  if (fit)
    out["fit"] = json::object{{"timestamp", time_or_null(fit_time)},
                              {"x", fit->x_px},
                              {"y", fit->y_px},
                              {"distanceMeters", number(fit->distance_m)},
                              {"strengthRatio", number(fit->strength_ratio)},
                              {"opticalThickness", number(fit->optical_thickness)},
                              {"residualRms", number(fit->residual_rms)}};
  return json_text(out);
}

std::string profile_json(const std::string& lamp, TimePoint time, const RingProfile& profile) {
  return json_text(json::object{
      {"id", lamp},
      {"timestamp", format_time_utc(time)},
      {"thetaDegrees", numbers(profile.theta_deg)},
      {"radiance", numbers(profile.radiance)},
      {"radianceSigma", numbers(profile.radiance_sigma)},
      {"model", profile.model.empty() ? json::value(nullptr) : json::value(numbers(profile.model))}});
}

std::string camera_json(const storage::CameraRecord& camera, const CameraHealth& health,
                        const std::optional<TimePoint>& last_observation_utc) {
  return json_text(json::object{{"camera", camera.name},
                                {"station", camera.station},
                                {"geometry", geometry(camera)},
                                {"width", camera.width_px},
                                {"height", camera.height_px},
                                {"lastObservation", time_or_null(last_observation_utc)},
                                {"sensor", health_json(health)}});
}

std::string picture_json(const storage::PictureRecord& picture) {
  const std::string time = format_time_utc(picture.time_utc);
  return json_text(json::object{{"camera", picture.camera},
                                {"time", time},
                                {"keptFor", to_string(picture.kept_for)},
                                {"bytes", picture.size_bytes},
                                {"href", "/v1/frames/" + picture.camera + "/" + time + ".jpg"}});
}

std::string json_string(std::string_view text) {
  return json_text(json::string(text));
}

std::string event_json(const storage::Event& event) {
  return json_text(json::object{{"id", event.number},
                                {"time", format_time_utc(event.time_utc)},
                                {"kind", to_string(event.kind)},
                                {"severity", to_string(event.severity)},
                                {"camera", text_or_null(event.camera)},
                                {"message", event.message}});
}

}  // namespace lampglow::web
