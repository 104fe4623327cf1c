// What systemd is told (sd_notify); nothing where there is no systemd.
#pragma once

#include <chrono>
#include <optional>
#include <string>

namespace lampglow::daemon {

void notify_ready();
void notify_reloading();
void notify_stopping();
void notify_status(const std::string& text);
void notify_watchdog();
// The unit's WatchdogSec=; empty if there is none.
std::optional<std::chrono::microseconds> watchdog_period();

}  // namespace lampglow::daemon
