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
// A step of long work at the start or in a reload is done: the watchdog is fed, and a start may take a minute
// longer from now. Told once a second at the most; one thread's.
void notify_progress();
// What comes may take so long: where a start's time would be over before, it goes on until then.
void notify_long_step(std::chrono::seconds at_most);
// The unit's WatchdogSec=; empty if there is none.
std::optional<std::chrono::microseconds> watchdog_period();

}  // namespace lampglow::daemon
