#include "daemon/config/csv.h"

#include <gmock/gmock.h>

namespace lampglow::daemon {
namespace {

std::string problems_of(std::string_view text) {
  Problems problems("f.csv");
  parse_csv(text, problems);
  return problems.to_string();
}

std::vector<std::vector<std::string>> rows_of(std::string_view text) {
  Problems problems("f.csv");
  const CsvTable table = parse_csv(text, problems);
  EXPECT_EQ(problems.to_string(), "");
  std::vector<std::vector<std::string>> rows;
  for (const auto& row : table.rows) {
    rows.emplace_back();
    for (const CsvCell& cell : row) rows.back().push_back(cell.text);
  }
  return rows;
}

using Rows = std::vector<std::vector<std::string>>;

TEST(Csv, ReadsPlainQuotedAndEmptyFields) {
  EXPECT_EQ(rows_of("a,b\n1,2\n,\n\"x,\"\"y\"\"\n z\",3"),
            (Rows{{"1", "2"}, {"", ""}, {"x,\"y\"\n z", "3"}}));
}

TEST(Csv, AcceptsCrLfByteOrderMarkAndBlankLines) {
  const auto rows = rows_of(
      "\xEF\xBB\xBF"
      "a,b\r\n1,\"2\"\r\n\r\n3,4\r\n");
  EXPECT_EQ(rows, (Rows{{"1", "2"}, {"3", "4"}}));
  Problems problems("f.csv");
  EXPECT_EQ(parse_csv("\xEF\xBB\xBF"
                      "a,b\n",
                      problems)
                .header[0]
                .text,
            "a");
}

TEST(Csv, KnowsWhereAFieldStands) {
  Problems problems("f.csv");
  const CsvTable table = parse_csv("a,b\n\"two\nlines\",x\nyy,z\n", problems);
  EXPECT_EQ(table.rows[0][1].line, 3U);
  EXPECT_EQ(table.rows[0][1].column, 8U);
  EXPECT_EQ(table.rows[1][1].line, 4U);
  EXPECT_EQ(table.rows[1][1].column, 4U);
}

TEST(Csv, TellsEveryBadRowAtOnce) {
  EXPECT_EQ(problems_of("a,b\n1\n2,3\n4,5,6\n"),
            "f.csv:2:1: expected 2 fields as in the header, got 1\n"
            "f.csv:4:1: expected 2 fields as in the header, got 3");
}

TEST(Csv, RefusesWhatIsNoCsv) {
  EXPECT_EQ(problems_of(""), "f.csv:1:1: expected a header line, the file is empty");
  EXPECT_EQ(problems_of("a,b\n1,\"2"), "f.csv:2:3: expected a closing quote, the file ends without one");
  EXPECT_EQ(problems_of("a,b\n\"1\"x,2\n"),
            "f.csv:2:4: expected a comma or the line's end after a closing quote");
  EXPECT_EQ(problems_of("a,b\n1\"x,2\n"),
            "f.csv:2:2: expected no quote, carriage return or zero byte within an unquoted field");
  EXPECT_EQ(problems_of("a,b,a\n"), "f.csv:1:5: a: the column stands twice in the header");
}

TEST(Csv, FindsColumnsInAnyOrderAndMissesTheAbsent) {
  Problems problems("f.csv");
  const CsvTable table = parse_csv("b,extra,a\n", problems);
  const auto places = find_columns(table, {"a", "b", "c"}, problems);
  EXPECT_EQ(places[0], 2U);
  EXPECT_EQ(places[1], 0U);
  EXPECT_EQ(problems.to_string(), "f.csv:1:1: c: the header lacks this column");
}

TEST(Csv, NumbersAreFiniteAndWhole) {
  EXPECT_EQ(parse_number("-1.5e3"), -1500.0);
  for (const char* text : {"", " 1", "1 ", "1,5", "0x10", "nan", "inf", "1e999", "12m"})
    EXPECT_FALSE(parse_number(text)) << text;
}

TEST(Csv, WrittenFieldsReadBack) {
  const std::string odd = "a,\"b\"\r\nc";
  EXPECT_EQ(rows_of("h\n" + csv_field(odd) + "\n"), (Rows{{odd}}));
  EXPECT_EQ(csv_field("plain"), "plain");
}

}  // namespace
}  // namespace lampglow::daemon
