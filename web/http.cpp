#include "web/http.h"

#include <fmt/chrono.h>

#include <boost/json.hpp>

namespace lampglow::web {

std::string_view status_title(int status) {
  switch (status) {
    case 200:
      return "OK";
    case 304:
      return "Not Modified";
    case 400:
      return "Bad Request";
    case 401:
      return "Unauthorized";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 406:
      return "Not Acceptable";
    case 408:
      return "Request Timeout";
    case 413:
      return "Content Too Large";
    case 414:
      return "URI Too Long";
    case 429:
      return "Too Many Requests";
    case 431:
      return "Request Header Fields Too Large";
    case 500:
      return "Internal Server Error";
    case 503:
      return "Service Unavailable";
    default:
      return "Error";
  }
}

Response problem(int status, const std::string& detail) {
  Response response;
  response.status = status;
  response.content_type = "application/problem+json";
  response.headers.emplace_back("Cache-Control", "no-store");
  response.body = boost::json::serialize(boost::json::object{
      {"type", "about:blank"}, {"title", status_title(status)}, {"status", status}, {"detail", detail}});
  return response;
}

std::string http_date(TimePoint time_utc) {
  return fmt::format("{:%a, %d %b %Y %H:%M:%S GMT}", std::chrono::floor<std::chrono::seconds>(time_utc));
}

}  // namespace lampglow::web
