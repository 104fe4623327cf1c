#include "web/query.h"

#include <algorithm>
#include <boost/json.hpp>
#include <boost/url.hpp>
#include <charconv>

namespace lampglow::web {
namespace {

namespace urls = boost::urls;

std::string quoted_list(std::span<const std::string_view> words) {
  std::string out;
  for (const std::string_view word : words) out += (out.empty() ? "" : ", ") + std::string(word);
  return out.empty() ? "none" : out;
}

// Whether it can stand in an answer.
bool is_utf8(const std::string& text) {
  boost::system::error_code error;
  boost::json::parse(boost::json::serialize(boost::json::string(text)), error);
  return !error;
}

std::string clean(std::string text, const char* what) {
  const auto bad = [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; };
  if (std::any_of(text.begin(), text.end(), bad))
    throw BadRequest(std::string(what) + " holds a control character");
  const auto beyond_ascii = [](char c) { return static_cast<unsigned char>(c) > 0x7f; };
  if (std::any_of(text.begin(), text.end(), beyond_ascii) && !is_utf8(text))
    throw BadRequest(std::string(what) + " is not UTF-8");
  return text;
}

// Percent-decoded; broken encodings were refused by the parser.
std::string decoded(urls::pct_string_view text) {
  urls::encoding_opts options;
  options.space_as_plus = true;
  return text.decode(options);
}

std::string decoded_path(const urls::url_view& url) {
  std::string path;
  for (const auto& segment : url.encoded_segments()) {
    const std::string word = segment.decode();
    if (word == ".." || word == "." || word.find('/') != std::string::npos)
      throw BadRequest("the path holds a segment that is not allowed");
    path += "/" + word;
  }
  return path.empty() ? "/" : clean(path, "the path");
}

}  // namespace

Target parse_target(std::string_view target) {
  const auto url = urls::parse_origin_form(target);
  if (!url) throw BadRequest("the request target is no path with an optional query");
  Target out;
  out.path = decoded_path(*url);
  for (const auto& parameter : url->encoded_params()) {
    const std::string key = clean(decoded(parameter.key), "a query parameter");
    if (!out.query.emplace(key, clean(decoded(parameter.value), key.c_str())).second)
      throw BadRequest("query parameter " + key + " comes twice");
  }
  return out;
}

Query::Query(const Target& target, std::span<const std::string_view> known) : values_(target.query) {
  for (const auto& [key, value] : values_)
    if (std::find(known.begin(), known.end(), key) == known.end())
      throw BadRequest("unknown query parameter " + key + "; known here: " + quoted_list(known));
}

std::string Query::text(std::string_view name) const {
  const auto found = values_.find(std::string(name));
  return found == values_.end() ? "" : found->second;
}

std::optional<TimePoint> Query::time(std::string_view name) const {
  const std::string value = text(name);
  if (value.empty()) return std::nullopt;
  const auto time = parse_time_utc(value);
  if (!time)
    throw BadRequest(std::string(name) + ": expected a time like 2026-11-22T01:00:00Z, got " + value);
  return time;
}

std::optional<std::int64_t> Query::integer(std::string_view name, std::int64_t low, std::int64_t high) const {
  const std::string value = text(name);
  if (value.empty()) return std::nullopt;
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
  if (error != std::errc{} || end != value.data() + value.size() || number < low || number > high)
    throw BadRequest(std::string(name) + ": expected a whole number from " + std::to_string(low) + " to " +
                     std::to_string(high) + ", got " + value);
  return number;
}

bool Query::boolean(std::string_view name) const {
  const std::string value = text(name);
  if (!value.empty() && value != "true" && value != "false")
    throw BadRequest(std::string(name) + ": expected true or false, got " + value);
  return value == "true";
}

std::string Query::one_of(std::string_view name, std::span<const std::string_view> choices) const {
  std::string value = text(name);
  if (value.empty()) return std::string(choices.front());
  if (std::find(choices.begin(), choices.end(), value) == choices.end())
    throw BadRequest(std::string(name) + ": expected one of " + quoted_list(choices) + ", got " + value);
  return value;
}

std::string percent_encode(std::string_view text) {
  return urls::encode(text, urls::unreserved_chars);
}

}  // namespace lampglow::web
