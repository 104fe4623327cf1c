#include "web/wire.h"

#include <boost/beast/core.hpp>
#include <ctime>

#include "web/http.h"

namespace lampglow::web {

namespace beast = boost::beast;
namespace http = beast::http;
using boost::system::error_code;

namespace {

std::string field(const WireRequest& request, http::field name) {
  return std::string(request[name]);
}

// Made once a second.
const std::string& http_date_now() {
  static thread_local std::time_t second = 0;
  static thread_local std::string text;
  if (const std::time_t now = std::time(nullptr); now != second || text.empty()) {
    second = now;
    text = http_date(TimePoint{std::chrono::seconds{now}});
  }
  return text;
}

}  // namespace

void limit(RequestParser& parser, int max_header_bytes, int max_body_bytes) {
  parser.header_limit(static_cast<std::uint32_t>(max_header_bytes));
  parser.body_limit(static_cast<std::uint64_t>(max_body_bytes));
}

Request to_request(const WireRequest& wire) {
  Request request;
  request.method = std::string(wire.method_string());
  request.target = std::string(wire.target());
  request.if_none_match = field(wire, http::field::if_none_match);
  request.accept = field(wire, http::field::accept);
  request.authorization = field(wire, http::field::authorization);
  request.last_event_id = std::string(wire["Last-Event-ID"]);
  return request;
}

std::string head_of(const Response& response, unsigned version, bool keep_alive, bool with_length) {
  std::string out;
  out.reserve(512);
  const auto line = [&out](std::string_view name, std::string_view value) {
    ((out += name) += ": ") += value;
    out += "\r\n";
  };
  const auto status = http::int_to_status(static_cast<unsigned>(response.status));
  out += version == 10 ? "HTTP/1.0 " : "HTTP/1.1 ";
  (out += std::to_string(response.status)) += ' ';
  const auto reason = http::obsolete_reason(status);
  out.append(reason.data(), reason.size()) += "\r\n";
  line("Server", "lampglow");
  line("Date", http_date_now());
  if (!response.content_type.empty()) line("Content-Type", response.content_type);
  for (const auto& [name, value] : response.headers) line(name, value);
  line("X-Content-Type-Options", "nosniff");
  line("X-Frame-Options", "DENY");
  line("Referrer-Policy", "no-referrer");
  line("Cross-Origin-Resource-Policy", "same-origin");
  if (!keep_alive)
    line("Connection", "close");
  else if (version == 10)
    line("Connection", "keep-alive");
  if (with_length && response.status != 304)
    line("Content-Length", std::to_string(response.content().size()));
  return out += "\r\n";
}

int status_of(const error_code& error) {
  if (error == http::error::header_limit || error == http::error::buffer_overflow) return 431;
  if (error == http::error::body_limit) return 413;
  if (error == beast::error::timeout) return 0;
  return error.category() == http::make_error_code(http::error::bad_method).category() &&
                 error != http::error::end_of_stream && error != http::error::partial_message
             ? 400
             : 0;
}

}  // namespace lampglow::web
