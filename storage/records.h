// What the store keeps beside the observations themselves, as its readers see it.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimator/observation.h"
#include "estimator/time.h"

namespace lampglow::storage {

// The number of a camera in one database. Names are what people and URLs use.
using CameraNumber = std::int64_t;

struct CameraRecord {
  CameraNumber number = 0;
  std::string name;     // unique in the database
  std::string station;  // [site] name
  std::optional<double> latitude_deg, longitude_deg, elevation_m;
  int width_px = 0, height_px = 0;  // 0: not yet known
};

// An observation, or the mean of those of a period. A mean is one of extinction, never of visibility (WMO).
// The mean's limit: `below` if any of its values is a `below`; `above` if `above` values make up at least
// half of the mean extinction. Bounds of a mean are the means of the bounds, an `above` counting from 0.
struct ObservationRow {
  Observation observation;  // of a mean: time_utc is the END of its period
  int period_s = 0;         // 0: a single frame
  int frames = 1;           // frames in the period, with or without a value
  int values = 0;           // those that had a value
  std::string reason;       // single frames: why there is no value
};

// A lamp of a camera, and what was last known of it.
struct LampRecord {
  std::string id;
  double x_px = 0, y_px = 0;  // in the clear reference
  std::optional<double> distance_m;
  std::optional<TimePoint> reference_since;  // when this entry of the catalogue came into force
};

// Stored numbers: they never change their meaning.
enum class EventKind : int {
  started = 1,
  stopped = 2,
  configuration_changed = 3,
  reference_learned = 4,
  source_failed = 5,
  source_recovered = 6,
  database_set_aside = 7,
  backup_made = 8,
  backup_failed = 9,
  disk_full = 10,
  clock_stepped = 11,
  retention = 12,
  fog_began = 13,
  fog_ended = 14,
  database_recovered = 15,
};
enum class Severity : int { info = 1, warning = 2, error = 3 };
std::string_view to_string(EventKind value);
std::string_view to_string(Severity value);

struct Event {
  std::int64_t number = 0;  // ascending in the order of writing
  TimePoint time_utc{};
  EventKind kind = EventKind::started;
  Severity severity = Severity::info;
  std::string camera;  // empty: the whole station
  std::string message;
};

// Why a picture was kept. Stored numbers.
enum class KeptFor : int { hourly = 1, fog_onset = 2 };
std::string_view to_string(KeptFor value);

struct PictureRecord {
  std::string camera;
  TimePoint time_utc{};
  KeptFor kept_for = KeptFor::hourly;
  std::int64_t size_bytes = 0;
};

}  // namespace lampglow::storage
