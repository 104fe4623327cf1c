#include "daemon/sources/truth.h"

#include <fmt/format.h>

#include <map>

#include "daemon/config/csv.h"
#include "daemon/config/files.h"
#include "daemon/config/problems.h"

namespace lampglow::daemon {
namespace {

class Row {
 public:
  Row(const CsvTable& table, const std::vector<CsvCell>& cells, Problems& problems)
      : table_(table), cells_(cells), problems_(problems) {}

  // Null if the file has no such column or the field is empty.
  const CsvCell* cell(std::string_view name) const {
    const auto place = table_.column(name);
    return place && !cells_[*place].text.empty() ? &cells_[*place] : nullptr;
  }

  std::optional<double> number(std::string_view name, double low, double high) {
    const CsvCell* found = cell(name);
    if (!found) return std::nullopt;
    const auto value = parse_number(found->text);
    if (value && *value >= low && *value <= high) return value;
    problems_.add(
        found->line, found->column, std::string(name),
        fmt::format("expected nothing or a number from {} to {}, got \"{}\"", low, high, found->text));
    return std::nullopt;
  }

  std::optional<Weather> weather() {
    const CsvCell* found = cell("weather");
    if (!found) return std::nullopt;
    const auto value = parse_weather(found->text);
    if (!value)
      problems_.add(found->line, found->column, "weather",
                    "expected clear, haze, mist, fog, rain or unknown, got \"" + found->text + "\"");
    return value;
  }

  std::optional<TimePoint> time() {
    const CsvCell& found = cells_[*table_.column("time_utc")];
    const auto value = parse_time_utc(found.text);
    if (!value)
      problems_.add(found.line, found.column, "time_utc",
                    "expected a time such as 2015-10-09T00:04:00Z, got \"" + found.text + "\"");
    return value;
  }

 private:
  const CsvTable& table_;
  const std::vector<CsvCell>& cells_;
  Problems& problems_;
};

}  // namespace

std::vector<Truth> read_truth(const std::filesystem::path& path) {
  Problems problems(path.string());
  const CsvTable table = parse_csv(read_text_file(path), problems);
  for (const auto& place : find_columns(table, {"time_utc", "mor_m"}, problems))
    if (!place) problems.throw_data_error();
  std::map<TimePoint, Truth> by_time;
  for (const auto& cells : table.rows) {
    Row row(table, cells, problems);
    const auto time = row.time();
    const Truth truth{time.value_or(TimePoint{}), row.number("mor_m", 0.1, 1e7),
                      row.number("period_s", 0, 86400), row.number("q", -1, 1), row.weather()};
    const auto [earlier, is_new] = by_time.try_emplace(truth.time_utc, truth);
    if (time && !is_new && earlier->second.mor_m != truth.mor_m)
      problems.add(cells.front().line, 1, "time_utc",
                   "expected one mor_m for a time; " + format_time_utc(*time) + " has two");
  }
  problems.throw_data_error();
  std::vector<Truth> truths;
  truths.reserve(by_time.size());
  for (const auto& [time, truth] : by_time) truths.push_back(truth);
  return truths;
}

}  // namespace lampglow::daemon
