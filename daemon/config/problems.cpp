#include "daemon/config/problems.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include "daemon/errors.h"

namespace lampglow::daemon {

void Problems::add(std::size_t line, std::size_t column, std::string field, std::string message) {
  problems_.push_back({line, column, std::move(field), std::move(message)});
}

std::string Problems::to_string() const {
  std::vector<Problem> sorted = problems_;
  std::stable_sort(sorted.begin(), sorted.end(), [](const Problem& a, const Problem& b) {
    return std::tie(a.line, a.column) < std::tie(b.line, b.column);
  });
  std::string text;
  for (const Problem& problem : sorted) {
    if (!text.empty()) text += '\n';
    text += file_;
    if (problem.line != 0) text += fmt::format(":{}:{}", problem.line, problem.column);
    if (!problem.field.empty()) text += ": " + problem.field;
    text += ": " + problem.message;
  }
  return text;
}

void Problems::throw_config_error() const {
  if (!empty()) throw ConfigError(to_string());
}

void Problems::throw_data_error() const {
  if (!empty()) throw DataError(to_string());
}

}  // namespace lampglow::daemon
