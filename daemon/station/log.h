// The station's log: one line for each message with fields as key=value, to stderr. Under systemd the line
// begins with its priority (<3>...), so that journald files it right.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace lampglow::daemon {

enum class LogLevel { debug, info, warning, error };
using LogFields = std::initializer_list<std::pair<std::string_view, std::string>>;

void open_log(LogLevel least);
void log(LogLevel level, std::string_view message, LogFields fields = {});

// "message key=value key2=\"two words\"", on one line whatever the values hold.
std::string log_line(std::string_view message, LogFields fields);

}  // namespace lampglow::daemon
