// What is wrong with an input file, collected so that all of it is told at once.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace lampglow::daemon {

struct Problem {
  std::size_t line = 0;    // from 1; 0: the file as a whole
  std::size_t column = 0;  // from 1, in bytes
  std::string field;       // "camera.width_px", "time_utc"; may be empty
  std::string message;     // what was expected, and what is there
};

class Problems {
 public:
  explicit Problems(std::string file) : file_(std::move(file)) {}

  void add(std::size_t line, std::size_t column, std::string field, std::string message);
  bool empty() const { return problems_.empty(); }

  // One line for each problem in the order of the file: `file:line:column: field: message`.
  std::string to_string() const;

  void throw_config_error() const;  // ConfigError (exit 78) if there is any problem
  void throw_data_error() const;    // DataError (exit 65) if there is any problem

 private:
  std::string file_;
  std::vector<Problem> problems_;
};

}  // namespace lampglow::daemon
