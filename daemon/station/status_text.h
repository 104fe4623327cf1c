// One line on how the station is, for systemctl status.
#pragma once

#include <string>

#include "web/live_state.h"

namespace lampglow::daemon {

// "quay: 830 m, fog; mole: no value (no_reference); FAULT database: cannot be written"
std::string status_text(const web::LiveState& live);

}  // namespace lampglow::daemon
