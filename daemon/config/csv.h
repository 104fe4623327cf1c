// CSV as in RFC 4180, read strictly: commas, quoted fields ("" for a quote, line breaks within quotes), LF or
// CRLF, a UTF-8 byte order mark at the start. Every row has as many fields as the header.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/config/problems.h"

namespace lampglow::daemon {

struct CsvCell {
  std::string text;
  std::size_t line = 0;    // where the field starts, from 1
  std::size_t column = 0;  // in bytes, from 1
};

struct CsvTable {
  std::vector<CsvCell> header;
  std::vector<std::vector<CsvCell>> rows;

  // Where a column stands; empty if the header has no such name.
  std::optional<std::size_t> column(std::string_view name) const;
};

// What is wrong goes to `problems` with line and column; rows with a wrong number of fields are left out.
// Blank lines are skipped.
CsvTable parse_csv(std::string_view text, Problems& problems);

// The columns' places in the order of `names`; a missing one is a problem.
std::vector<std::optional<std::size_t>> find_columns(const CsvTable& table,
                                                     const std::vector<std::string_view>& names,
                                                     Problems& problems);

// A finite decimal number, the whole text; empty if it is anything else.
std::optional<double> parse_number(std::string_view text);

// A field as CSV: quoted where it must be.
std::string csv_field(std::string_view text);

}  // namespace lampglow::daemon
