// The JSON, CSV and GeoJSON shapes of the interface: NWS-like GeoJSON Features with quantities
// {value, minValue, maxValue, unitCode}. Unknown is null.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "storage/records.h"

namespace lampglow::web {

// A Feature cut in two where the age stands, so that an answer is put together without serialising:
// head + age in seconds + tail.
struct FeatureHalves {
  std::string head;
  std::string tail;
};

struct CameraHealth {
  bool up = false;
  std::string fault;    // name of the fault; empty: none
  std::string message;  // for people, without secrets
  std::optional<TimePoint> last_frame_utc;
  std::optional<TimePoint> next_due_utc;
  std::map<std::string, std::uint64_t>
      tries{};  // of the source since the start, by the fault's name; "none": good
};

struct CurrentParts {
  const storage::CameraRecord* camera = nullptr;
  const storage::ObservationRow* latest = nullptr;
  const storage::ObservationRow* one_minute = nullptr;  // running means that end with the latest frame
  const storage::ObservationRow* ten_minutes = nullptr;
  std::string trend;  // "improving", "steady", "worsening"; empty: not known
  CameraHealth health;
  std::int64_t stale_after_s = 0;  // so that a page that hears nothing more knows when it shows the past
};

// The current observation. `stale`: every measured quantity is null, the rest says how old it is.
FeatureHalves current_feature(const CurrentParts& parts, bool stale);

// "quay/2026-11-22T01:00:00Z", with /600 for a mean: the Feature's id and, quoted, the ETag.
std::string observation_id(const storage::CameraRecord& camera, const storage::ObservationRow& row);

// One observation as a Feature (without age).
std::string observation_feature(const storage::CameraRecord& camera, const storage::ObservationRow& row);
// As an entry of the plain JSON list: flat, with the names of the CSV's columns; appended, for there are
// many.
void append_observation_json(std::string& out, const storage::ObservationRow& row);

// The columns of replay's CSV and behind them camera, period_s, frames, values.
std::string observation_csv_header();
std::string observation_csv(const storage::CameraRecord& camera, const storage::ObservationRow& row);

// A lamp of the catalogue with the last fit's result, if there is one; its ring profile by itself. `current`:
// the fit says what state the lamp is in now.
std::string light_json(const storage::LampRecord& lamp, const LampFit* fit, std::optional<TimePoint> fit_time,
                       bool current);
std::string profile_json(const std::string& lamp, TimePoint time, const RingProfile& profile);
std::string camera_json(const storage::CameraRecord& camera, const CameraHealth& health,
                        const std::optional<TimePoint>& last_observation_utc);
std::string picture_json(const storage::PictureRecord& picture);

// A quoted and escaped JSON string.
std::string json_string(std::string_view text);

std::string event_json(const storage::Event& event);

}  // namespace lampglow::web
