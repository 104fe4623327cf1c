// Observations and ring profiles to and from table rows. Included by this folder's .cpp files only.
#pragma once

#include <string>

#include "estimator/observation.h"
#include "storage/records.h"
#include "storage/sqlite.h"

namespace lampglow::storage {

// The columns of table observation after (camera_id, time_ms), in the order of the functions below.
inline constexpr const char* kObservationColumns =
    "extinction_per_m, extinction_low_per_m, extinction_high_per_m, limit_kind, q, q_low, q_high, weather, "
    "probability_unknown, probability_clear, probability_haze, probability_mist, probability_fog, "
    "probability_rain, lecture_class, wmo_4680, relative_humidity, method, lights_used, quality";

// The columns of table mean after (camera_id, period_s, end_ms).
inline constexpr const char* kMeanColumns =
    "frames, value_count, extinction_per_m, extinction_low_per_m, extinction_high_per_m, limit_kind, q, "
    "q_low, "
    "q_high, weather, relative_humidity, method, lights_used, quality";

void bind_observation(Binder& binder, const Observation& observation);
// All but the time. Numbers that no enum knows (a damaged or newer row) become unknown or none.
Observation read_observation(RowReader& row);

void bind_mean(Binder& binder, const ObservationRow& mean);
ObservationRow read_mean(RowReader& row);

std::string pack_rings(const RingProfile& profile);
// Empty if the blob's size does not fit the count.
RingProfile unpack_rings(std::string_view blob, std::int64_t ring_count);

LampState lamp_state(int number);

}  // namespace lampglow::storage
