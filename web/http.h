// A request and an answer without sockets: what the server parses and what the interface answers.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "estimator/time.h"

namespace lampglow::web {

struct Request {
  std::string method;  // "GET"
  std::string target;  // "/v1/observations?camera=quay", as sent
  std::string if_none_match;
  std::string accept;
  std::string authorization;
  std::string last_event_id;
};

struct Response {
  int status = 200;
  std::string content_type;
  std::vector<std::pair<std::string, std::string>> headers;
  std::string body;
  std::shared_ptr<const std::string> shared_body;  // instead of body, for what many clients get

  std::string_view content() const {
    return shared_body ? std::string_view(*shared_body) : std::string_view(body);
  }
};

// RFC 9457: application/problem+json with type about:blank, title by status, and this detail.
Response problem(int status, const std::string& detail);

std::string_view status_title(int status);

// "Sun, 22 Nov 2026 01:00:00 GMT" (RFC 9110, 5.6.7).
std::string http_date(TimePoint time_utc);

}  // namespace lampglow::web
