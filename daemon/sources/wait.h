// Waiting for a descriptor, a deadline or a stop, without polling loops.
#pragma once

#include <chrono>
#include <stop_token>

#include "estimator/time.h"

namespace lampglow::daemon {

enum class Wait { ready, timeout, stopped };

// Until fd is readable (or has an error to tell), the deadline passes, or a stop is asked for. Throws
// std::system_error where the system has no more descriptors.
Wait wait_readable(int fd, std::chrono::steady_clock::time_point deadline, std::stop_token stop);

}  // namespace lampglow::daemon
