// What the JSON shapes are made of. For web/'s own sources.
#pragma once

#include <boost/json.hpp>
#include <optional>
#include <string>
#include <string_view>

#include "storage/records.h"
#include "web/shapes.h"

namespace lampglow::web {

namespace json = boost::json;

// The shortest text that reads back as the same number: 3648.55, where Boost writes 3.64855E3. What is not
// finite is null.
void append_json_number(std::string& out, double value);
std::string json_text(const json::value& value);

json::value number(const std::optional<double>& value);
json::value text_or_null(std::string_view text);
json::value time_or_null(const std::optional<TimePoint>& time);
json::object quantity(const char* unit, const std::optional<double>& value, const std::optional<double>& low,
                      const std::optional<double>& high);
json::value geometry(const storage::CameraRecord& camera);
json::object health_json(const CameraHealth& health);

}  // namespace lampglow::web
