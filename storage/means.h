// Means over a period: of extinction, never of visibility (WMO-No. 8; conventions.md).
#pragma once

#include <array>
#include <span>

#include "storage/records.h"

namespace lampglow::storage {

inline constexpr std::array<int, 3> kMeanPeriods_s = {60, 600, 3600};

// The end of the period that `time` belongs to: periods are (end - period, end], ends are whole multiples of
// the period since 1970 UTC.
TimePoint period_end(TimePoint time, int period_s);

// The mean of the period that ends at `end`. `frames` are in the order of time. Without a value among them
// the mean has none, but counts and flags.
ObservationRow mean_of(std::span<const Observation> frames, TimePoint end, int period_s);

}  // namespace lampglow::storage
