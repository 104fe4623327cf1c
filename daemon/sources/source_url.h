// A source's URL as text. Needs no driver, so that a configuration can be read without any.
#pragma once

#include <string>
#include <string_view>

namespace lampglow::daemon {

// What is wrong with a source's URL, in words that follow it: no known kind, or a password in it. Empty:
// nothing.
std::string url_problem(std::string_view url);

// The URL without anything that may be secret: user, password, query, and the path, in which some cameras
// want their password: "rtsp://host:554/…".
std::string redacted_url(std::string_view url);

}  // namespace lampglow::daemon
