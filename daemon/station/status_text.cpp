#include "daemon/station/status_text.h"

#include <fmt/format.h>

namespace lampglow::daemon {

std::string status_text(const web::LiveState& live) {
  std::string text;
  for (const storage::CameraRecord& camera : live.cameras()) {
    const auto latest = live.latest_result(camera.name);
    const auto mor_m = latest ? latest->observation.mor_m() : std::nullopt;
    if (!text.empty()) text += "; ";
    text += camera.name + ": ";
    if (!latest)
      text += "no frame yet";
    else if (!mor_m)
      text += "no value (" + latest->reason.substr(0, 60) + ")";
    else
      text += fmt::format("{}{:.0f} m, {}",
                          latest->observation.limit == Limit::above   ? "above "
                          : latest->observation.limit == Limit::below ? "below "
                                                                      : "",
                          *mor_m, to_string(latest->observation.weather));
  }
  for (const std::string& fault : live.faults()) text += "; FAULT " + fault;
  return text;
}

}  // namespace lampglow::daemon
