#include "web/metrics_text.h"

#include <charconv>

namespace lampglow::web {
namespace {

std::string shortest(double value) {
  char text[40];
  return {text, std::to_chars(text, text + sizeof text, value).ptr};
}

std::string label(const std::string& name, const std::string& value) {
  std::string escaped;
  for (const char c : value) {
    if (c == '\\' || c == '"') escaped += '\\';
    escaped += c == '\n' ? ' ' : c;
  }
  return name + "=\"" + escaped + "\"";
}

class Text {
 public:
  void family(const std::string& name, const std::string& type, const std::string& help) {
    out_ += "# HELP " + name + " " + help + "\n# TYPE " + name + " " + type + "\n";
  }
  void sample(const std::string& name, const std::string& labels, double value) {
    out_ += name + (labels.empty() ? "" : "{" + labels + "}") + " " + shortest(value) + "\n";
  }
  std::string take() { return std::move(out_); }

 private:
  std::string out_;
};

void durations(Text& text, const CameraMetrics& camera) {
  const std::string who = label("camera", camera.name);
  for (size_t i = 0; i < CameraCounters::kBuckets_s.size(); ++i)
    text.sample("lampglow_fit_duration_seconds_bucket",
                who + "," + label("le", shortest(CameraCounters::kBuckets_s[i])),
                static_cast<double>(camera.counters.below[i]));
  text.sample("lampglow_fit_duration_seconds_bucket", who + ",le=\"+Inf\"",
              static_cast<double>(camera.counters.timed));
  text.sample("lampglow_fit_duration_seconds_sum", who, camera.counters.total_s);
  text.sample("lampglow_fit_duration_seconds_count", who, static_cast<double>(camera.counters.timed));
}

// One gauge of all cameras whose current observation has that value.
template <typename Value>
void gauge(Text& text, const MetricsInput& input, const std::string& name, const std::string& help,
           Value value) {
  text.family(name, "gauge", help);
  for (const CameraMetrics& camera : input.cameras)
    if (const std::optional<double> v = value(camera)) text.sample(name, label("camera", camera.name), *v);
}

template <typename Field>
auto of_fresh(Field field) {
  return [field](const CameraMetrics& camera) -> std::optional<double> {
    return camera.fresh ? field(*camera.fresh) : std::nullopt;
  };
}

void observations(Text& text, const MetricsInput& input) {
  gauge(text, input, "lampglow_visibility_meters",
        "MOR (5 % contrast); a bound where lampglow_visibility_limit is not 0.",
        of_fresh([](const Observation& o) { return o.mor_m(); }));
  gauge(text, input, "lampglow_visibility_limit", "0: a value, 1: visibility is at least it, -1: at most.",
        of_fresh([](const Observation& o) -> std::optional<double> {
          if (!o.extinction_per_m) return std::nullopt;
          return o.limit == Limit::above ? 1 : o.limit == Limit::below ? -1 : 0;
        }));
  gauge(text, input, "lampglow_extinction_per_meter", "Extinction coefficient.",
        of_fresh([](const Observation& o) { return o.extinction_per_m; }));
  gauge(text, input, "lampglow_forward_scattering_ratio", "Henyey-Greenstein asymmetry q.",
        of_fresh([](const Observation& o) { return o.q; }));
  gauge(text, input, "lampglow_lights_used", "Lamps, or targets by day, in the last fit.",
        of_fresh([](const Observation& o) { return std::optional<double>(o.lights_used); }));
  gauge(text, input, "lampglow_last_observation_timestamp_seconds", "Time of the last frame, UTC.",
        [](const CameraMetrics& camera) -> std::optional<double> {
          if (!camera.last_observation_utc) return std::nullopt;
          return static_cast<double>(camera.last_observation_utc->time_since_epoch().count()) / 1000;
        });
  gauge(text, input, "lampglow_camera_up", "1 while the camera gives pictures.",
        [](const CameraMetrics& camera) { return std::optional<double>(camera.up ? 1 : 0); });
}

}  // namespace

void CameraCounters::count(bool value, std::optional<double> duration_s) {
  ++(value ? with_value : without_value);
  if (!duration_s) return;
  ++timed;
  total_s += *duration_s;
  for (size_t i = 0; i < below.size(); ++i)
    if (*duration_s <= kBuckets_s[i]) ++below[i];
}

std::string prometheus_text(const MetricsInput& input) {
  Text text;
  text.family("lampglow_build_info", "gauge", "Always 1; what runs here.");
  text.sample("lampglow_build_info", label("version", input.version), 1);
  observations(text, input);
  text.family("lampglow_frames_total", "counter", "Frames since the start, with and without a value.");
  for (const CameraMetrics& camera : input.cameras) {
    const std::string who = label("camera", camera.name);
    text.sample("lampglow_frames_total", who + ",result=\"value\"",
                static_cast<double>(camera.counters.with_value));
    text.sample("lampglow_frames_total", who + ",result=\"none\"",
                static_cast<double>(camera.counters.without_value));
  }
  text.family(
      "lampglow_camera_tries_total", "counter",
      "Tries to get a picture since the camera was opened, by what came of them; none: a good picture.");
  for (const CameraMetrics& camera : input.cameras)
    for (const auto& [reason, count] : camera.tries)
      text.sample("lampglow_camera_tries_total", label("camera", camera.name) + "," + label("reason", reason),
                  static_cast<double>(count));
  text.family("lampglow_fit_duration_seconds", "histogram", "Time from frame to observation.");
  for (const CameraMetrics& camera : input.cameras) durations(text, camera);
  text.family("lampglow_http_requests_total", "counter", "Answers by status.");
  for (const auto& [status, count] : input.requests)
    text.sample("lampglow_http_requests_total", label("code", std::to_string(status)),
                static_cast<double>(count));
  text.family("lampglow_stream_clients", "gauge", "Clients of the event stream.");
  text.sample("lampglow_stream_clients", "", input.stream_clients);
  text.family("lampglow_fault", "gauge",
              "1 for each part of the station that has failed and is being worked round.");
  for (const std::string& part : input.faults) text.sample("lampglow_fault", label("part", part), 1);
  return text.take();
}

}  // namespace lampglow::web
