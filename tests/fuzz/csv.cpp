// CSV as it stands in an archive.
#include <cstdint>
#include <string>

#include "daemon/config/csv.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lampglow::daemon;
  Problems problems("fuzz.csv");
  const CsvTable table = parse_csv(std::string(data, data + size), problems);
  for (const auto& row : table.rows)
    for (const auto& cell : row) (void)parse_number(cell.text);
  (void)problems.to_string();
  return 0;
}
