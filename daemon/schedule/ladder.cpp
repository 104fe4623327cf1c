#include "daemon/schedule/ladder.h"

namespace lampglow::daemon {

using std::chrono::milliseconds;

milliseconds ReconnectLadder::rung(int failures) {
  if (failures <= 5) return milliseconds(1'000);
  if (failures <= 10) return milliseconds(5'000);
  if (failures <= 20) return milliseconds(10'000);
  return milliseconds(60'000);
}

milliseconds ReconnectLadder::next_delay() {
  ++failures_;
  // The engine's raw bits: std distributions may differ between libraries.
  const auto per_mille = static_cast<std::int64_t>(800 + random_() % 401);
  return rung(failures_) * per_mille / 1000;
}

}  // namespace lampglow::daemon
