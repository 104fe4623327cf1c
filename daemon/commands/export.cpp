#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/commands/database.h"
#include "daemon/errors.h"
#include "storage/reader.h"
#include "web/shapes.h"

namespace lampglow::daemon {
namespace {

struct Arguments {
  std::string database, camera, from, to, step = "raw", format = "csv";
};

const std::map<std::string, int> kPeriods_s = {{"raw", 0}, {"1min", 60}, {"10min", 600}, {"hour", 3600}};

TimePoint time_of(const char* option, const std::string& text, TimePoint otherwise) {
  if (text.empty()) return otherwise;
  const auto time = parse_time_utc(text);
  if (!time)
    throw UsageError(std::string(option) + ": expected a time like 2026-11-22T01:00:00Z, got " + text);
  return *time;
}

// Page by page, so that a year needs no more memory than a day.
void each_row(storage::Reader& reader, storage::ObservationQuery query,
              const std::function<void(const storage::ObservationRow&)>& use) {
  for (auto rows = reader.observations(query); !rows.empty(); rows = reader.observations(query)) {
    for (const auto& row : rows) use(row);
    query.after = rows.back().observation.time_utc;
  }
}

void put(const std::string& text) {
  if (std::fwrite(text.data(), 1, text.size(), stdout) != text.size())
    throw IoError("cannot write the output");
}

void export_rows(const Arguments& a) {
  needs_database(a.database);
  storage::Reader reader(a.database);
  const storage::CameraRecord camera = camera_of(reader, a.camera);
  const storage::ObservationQuery query{camera.number,
                                        time_of("--from", a.from, TimePoint{}),
                                        time_of("--to", a.to, parse_time_utc("9999-12-31T00:00:00Z").value()),
                                        kPeriods_s.at(a.step),
                                        {},
                                        5000};
  if (a.format == "csv") {
    put(web::observation_csv_header());
    each_row(reader, query, [&](const auto& row) { put(web::observation_csv(camera, row)); });
    return;
  }
  put("[");
  bool first = true;
  each_row(reader, query, [&](const auto& row) {
    std::string text = first ? "\n" : ",\n";
    first = false;
    web::append_observation_json(text, row);
    put(text);
  });
  put("\n]\n");
}

}  // namespace

void add_export(CLI::App& program) {
  CLI::App* command = program.add_subcommand("export", "Write stored observations as CSV or JSON");
  auto a = std::make_shared<Arguments>();
  command->add_option("DATABASE", a->database, "The database")->required();
  command->add_option("--camera", a->camera, "Which camera, if there are several")->type_name("NAME");
  command->add_option("--from", a->from, "First time, UTC")->type_name("TIME");
  command->add_option("--to", a->to, "End, not in it, UTC")->type_name("TIME");
  command->add_option("--step", a->step, "raw frames, or means of extinction over 1min, 10min, hour")
      ->check(CLI::IsMember({"raw", "1min", "10min", "hour"}));
  command->add_option("--format", a->format, "csv or json")->check(CLI::IsMember({"csv", "json"}));
  command->footer(
      "Example:\n  lampglow export /var/lib/lampglow/lampglow.db --from 2026-11-01T00:00:00Z --step hour > "
      "month.csv");
  command->callback([a] { with_storage_errors([&] { export_rows(*a); }); });
}

}  // namespace lampglow::daemon
