#include "daemon/config/csv.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace lampglow::daemon {
namespace {

// Walks over the text and keeps count of line and column.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : text_(text) {}
  bool at_end() const { return at_ == text_.size(); }
  bool at_line_end() const { return peek() == '\n' || (peek() == '\r' && peek(1) == '\n'); }
  char peek(std::size_t ahead = 0) const { return at_ + ahead < text_.size() ? text_[at_ + ahead] : '\0'; }
  std::size_t line() const { return line_; }
  std::size_t column() const { return at_ - line_start_ + 1; }

  char take() {
    const char c = text_[at_++];
    if (c == '\n') {
      ++line_;
      line_start_ = at_;
    }
    return c;
  }

  void take_line_end() {
    if (peek() == '\r') take();
    take();
  }

  void skip_line() {
    while (!at_end() && take() != '\n') {
    }
  }

 private:
  std::string_view text_;
  std::size_t at_ = 0;
  std::size_t line_ = 1;
  std::size_t line_start_ = 0;
};

// The rest of a field whose opening quote is taken; false after a problem.
bool scan_quoted(Scanner& scan, CsvCell& cell, Problems& problems) {
  while (!scan.at_end()) {
    const char c = scan.take();
    if (c != '"') {
      cell.text += c;
    } else if (scan.peek() == '"') {
      cell.text += scan.take();
    } else {
      if (scan.at_end() || scan.peek() == ',' || scan.at_line_end()) return true;
      problems.add(scan.line(), scan.column(), "",
                   "expected a comma or the line's end after a closing quote");
      return false;
    }
  }
  problems.add(cell.line, cell.column, "", "expected a closing quote, the file ends without one");
  return false;
}

bool scan_plain(Scanner& scan, CsvCell& cell, Problems& problems) {
  while (!scan.at_end() && scan.peek() != ',' && !scan.at_line_end()) {
    if (scan.peek() == '"' || scan.peek() == '\r' || scan.peek() == '\0') {
      problems.add(scan.line(), scan.column(), "",
                   "expected no quote, carriage return or zero byte within an unquoted field");
      return false;
    }
    cell.text += scan.take();
  }
  return true;
}

// One row up to and with its line's end; false after a problem.
bool scan_row(Scanner& scan, std::vector<CsvCell>& row, Problems& problems) {
  for (;;) {
    CsvCell cell{"", scan.line(), scan.column()};
    const bool quoted = scan.peek() == '"';
    if (quoted) scan.take();
    if (!(quoted ? scan_quoted(scan, cell, problems) : scan_plain(scan, cell, problems))) {
      scan.skip_line();
      return false;
    }
    row.push_back(std::move(cell));
    if (scan.at_end()) return true;
    if (scan.at_line_end()) {
      scan.take_line_end();
      return true;
    }
    scan.take();
  }
}

void check_header(const CsvTable& table, Problems& problems) {
  for (std::size_t i = 0; i < table.header.size(); ++i) {
    const CsvCell& cell = table.header[i];
    if (const auto first = table.column(cell.text); first && *first != i)
      problems.add(cell.line, cell.column, cell.text, "the column stands twice in the header");
  }
}

}  // namespace

std::optional<std::size_t> CsvTable::column(std::string_view name) const {
  for (std::size_t i = 0; i < header.size(); ++i)
    if (header[i].text == name) return i;
  return std::nullopt;
}

CsvTable parse_csv(std::string_view text, Problems& problems) {
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  Scanner scan(text);
  CsvTable table;
  while (!scan.at_end()) {
    if (scan.at_line_end()) {
      scan.take_line_end();
      continue;
    }
    std::vector<CsvCell> row;
    const bool header = table.header.empty();
    if (!scan_row(scan, row, problems)) {
      if (header) return table;
      continue;
    }
    if (header) {
      table.header = std::move(row);
      check_header(table, problems);
    } else if (row.size() != table.header.size()) {
      problems.add(
          row.front().line, 1, "",
          fmt::format("expected {} fields as in the header, got {}", table.header.size(), row.size()));
    } else {
      table.rows.push_back(std::move(row));
    }
  }
  if (table.header.empty()) problems.add(1, 1, "", "expected a header line, the file is empty");
  return table;
}

std::vector<std::optional<std::size_t>> find_columns(const CsvTable& table,
                                                     const std::vector<std::string_view>& names,
                                                     Problems& problems) {
  std::vector<std::optional<std::size_t>> places;
  for (const std::string_view name : names) {
    places.push_back(table.column(name));
    if (!places.back() && !table.header.empty())
      problems.add(table.header.front().line, 1, std::string(name), "the header lacks this column");
  }
  return places;
}

std::optional<double> parse_number(std::string_view text) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc{} || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::string csv_field(std::string_view text) {
  if (text.find_first_of(",\"\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

}  // namespace lampglow::daemon
