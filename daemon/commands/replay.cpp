#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/config/files.h"
#include "daemon/errors.h"
#include "daemon/replay/replay.h"
#include "daemon/replay/replay_server.h"
#include "daemon/replay/report.h"
#include "daemon/replay/stop_on_signal.h"
#include "daemon/sources/truth.h"
#include "storage/error.h"

namespace lampglow::daemon {
namespace {

constexpr std::size_t kLongestTable = 200;

struct Arguments {
  std::string archive, site_file, database, csv, truth, report, model = "table";
  std::size_t workers = 0;
  bool json = false;
  bool serve = false;
  bool relearn = false;
  std::uint16_t port = 8080;
};

std::optional<std::filesystem::path> path_or_none(const std::string& text) {
  if (text.empty()) return std::nullopt;
  return text;
}

ReplayOptions to_options(const Arguments& arguments) {
  ReplayOptions options;
  options.archive = arguments.archive;
  options.site_file = path_or_none(arguments.site_file);
  options.database = path_or_none(arguments.database);
  options.csv = path_or_none(arguments.csv);
  options.workers = arguments.workers;
  options.estimator.model = inference::parse_halo_kind(arguments.model).value_or(options.estimator.model);
  if (arguments.relearn) options.relearn.emplace();
  return options;
}

// One line on a terminal that is drawn over and over; silent elsewhere.
void draw_progress(const ReplayRecord& record, std::size_t done, std::size_t total) {
  constexpr std::size_t kWidth = 40;
  const std::size_t filled = total == 0 ? kWidth : kWidth * done / total;
  fmt::print(stderr, "\r[{:<{}}] {}/{} {}", std::string(filled, '#'), kWidth, done, total,
             format_time_utc(record.observation.time_utc));
  if (done == total) fmt::print(stderr, "\r\033[K");
  std::fflush(stderr);
}

// OUT.csv -> OUT.scores.json: beside the first file that the run writes.
std::optional<std::filesystem::path> scores_path(const Arguments& arguments) {
  for (const std::string& file : {arguments.csv, arguments.report, arguments.database})
    if (!file.empty()) return std::filesystem::path(file).replace_extension(".scores.json");
  return std::nullopt;
}

void print_scores(const ReplayResult& result, const std::vector<Truth>& truths) {
  const auto pairs = match_truth(scored_observations(result), truths);
  fmt::print("\n{}", format_scores(score(pairs), score_by_range(pairs)));
}

void print_result(const Arguments& arguments, const ReplayResult& result, const std::vector<Truth>& truths) {
  if (arguments.json) {
    fmt::print("{}", format_json(result, truths));
    return;
  }
  if (result.records.size() <= kLongestTable) fmt::print("{}\n", format_table(result, truths));
  fmt::print("{}", format_summary(result));
  if (!truths.empty()) print_scores(result, truths);
}

// The files' names, for the user.
std::vector<std::string> write_files(const Arguments& arguments, const ReplayOptions& options,
                                     const ReplayResult& result, const std::vector<Truth>& truths) {
  std::vector<std::string> written;
  for (const std::string& file : {arguments.csv, arguments.database})
    if (!file.empty()) written.push_back(file);
  if (const auto file = scores_path(arguments); file && !truths.empty()) {
    write_file_atomically(*file, format_scores_json(result, truths));
    written.push_back(file->string());
  }
  if (!arguments.report.empty()) {
    write_file_atomically(arguments.report, format_report(options, result, truths));
    written.push_back(arguments.report);
  }
  return written;
}

ReplayListener make_listener(ReplayServer* server) {
  ReplayListener listener;
  if (::isatty(STDERR_FILENO) != 0) listener.progress = draw_progress;
  if (server) {
    listener.site = [server](const Site& site) { server->set_site(site); };
    listener.result = [server](const FrameResult& result) { server->publish(result); };
  }
  return listener;
}

void replay(const Arguments& arguments) {
  const StopOnSignal stop;
  std::vector<Truth> truths;
  if (!arguments.truth.empty()) truths = read_truth(arguments.truth);
  const ReplayOptions options = to_options(arguments);
  std::unique_ptr<ReplayServer> server;
  if (arguments.serve)
    server = std::make_unique<ReplayServer>(
        ReplayServerOptions{arguments.port, path_or_none(arguments.database), LAMPGLOW_VERSION});

  const ReplayResult result = run_replay(options, stop.token(), make_listener(server.get()));
  for (const std::string& warning : result.warnings) fmt::print(stderr, "lampglow: warning: {}\n", warning);
  print_result(arguments, result, truths);
  const std::vector<std::string> written = write_files(arguments, options, result, truths);
  if (!arguments.json)
    for (const std::string& file : written) fmt::print("wrote {}\n", file);
  if (!server || stop.token().stop_requested()) return;
  server->show_last_picture(options, result);
  fmt::print("serving until Ctrl-C: http://127.0.0.1:{0}/ and http://127.0.0.1:{0}/v1/current\n",
             server->port());
  std::fflush(stdout);
  stop.wait();
}

}  // namespace

void add_replay(CLI::App& program) {
  CLI::App* command =
      program.add_subcommand("replay", "Estimate the visibility of every frame of an archive");
  auto a = std::make_shared<Arguments>();
  command->add_option("ARCHIVE", a->archive, "The archive's folder: site.toml, frames.csv, images/")
      ->required();
  command->add_option("--site", a->site_file, "Another site file than ARCHIVE/site.toml")->type_name("FILE");
  command->add_option("--db", a->database, "Store the results in this SQLite database")->type_name("FILE");
  command->add_option("--csv", a->csv, "Write one line for every frame")->type_name("FILE");
  command->add_option("--truth", a->truth, "Score against this sensor's record (truth.csv)")
      ->type_name("FILE");
  command->add_option("--model", a->model, "Scattering model of the lamps' halos")
      ->check(CLI::IsMember({"table", "apsf_series", "single", "diffusion"}))
      ->capture_default_str();
  command->add_flag("--relearn", a->relearn, "Let nights teach the reference slowly, as serve does");
  command->add_option("--report", a->report, "Write a report as one HTML file")->type_name("FILE");
  command->add_option("--workers", a->workers, "Threads that estimate; the cores if not given")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  command->add_flag("--json", a->json, "Print records and scores as JSON instead of tables");
  command->add_flag("--serve", a->serve,
                    "Answer over HTTP on 127.0.0.1 while it runs and after it, until Ctrl-C");
  command->add_option("--port", a->port, "Port for --serve; 0 for any free one")
      ->type_name("N")
      ->capture_default_str();
  command->footer(
      "Example:\n  lampglow replay night --truth night/truth.csv --csv night.csv --report night.html\n\n"
      "The scores go to a file beside the first of --csv, --report and --db: night.scores.json.");
  command->callback([a] {
    try {
      replay(*a);
    } catch (const storage::StorageError& error) {
      throw IoError(a->database + ": " + error.what());
    }
  });
}

}  // namespace lampglow::daemon
