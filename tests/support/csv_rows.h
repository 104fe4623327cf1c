// A CSV's fields by each row's time.
#pragma once

#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace lampglow::test {

inline std::map<std::string, std::vector<std::string>> rows_by_time(const std::string& csv) {
  std::map<std::string, std::vector<std::string>> rows;
  std::istringstream lines(csv);
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> fields;
    std::istringstream in(line);
    for (std::string field; std::getline(in, field, ',');) fields.push_back(field);
    if (!fields.empty()) rows[fields.front()] = fields;
  }
  return rows;
}

}  // namespace lampglow::test
