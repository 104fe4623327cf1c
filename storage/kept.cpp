#include "storage/kept.h"

namespace lampglow::storage {

Place place_of(Kept what) {
  switch (what) {
    case Kept::frames:
      return {"frame", "time_ms", ""};
    case Kept::observations:
      return {"observation", "time_ms", ""};
    case Kept::fits:
      return {"lamp_fit", "time_ms", ""};
    case Kept::ring_profiles:
      return {"ring_profile", "time_ms", ""};
    case Kept::one_minute:
      return {"mean", "end_ms", " AND period_s = 60"};
    case Kept::ten_minutes:
      return {"mean", "end_ms", " AND period_s = 600"};
    case Kept::hours:
      return {"mean", "end_ms", " AND period_s = 3600"};
    case Kept::events:
      return {"event", "time_ms", ""};
  }
  return {"event", "time_ms", ""};
}

}  // namespace lampglow::storage
