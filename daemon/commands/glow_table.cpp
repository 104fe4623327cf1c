#include <unistd.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdio>
#include <memory>

#include "daemon/commands/commands.h"
#include "daemon/commands/threads.h"
#include "daemon/config/pending_file.h"
#include "estimator/scattering/glow_table_builder.h"

namespace lampglow::daemon {
namespace {

struct Options {
  std::string out;
  unsigned threads = 0;
  scattering::GlowTableOptions grid;
};

void run(const Options& options) {
  PendingFile out(options.out);  // told now if it cannot be written, not after minutes
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::atomic<std::size_t> done{0};
  const auto progress = [&](std::size_t total) {
    const std::size_t solved = ++done;
    if (terminal) std::fprintf(stderr, "\rq %zu of %zu%s", solved, total, solved == total ? "\n" : "");
  };
  const auto file = scattering::build_glow_table(options.grid, threads(options.threads), progress);
  out.write({reinterpret_cast<const char*>(file.data()), file.size()});
  out.publish();
  std::printf("%s: %zu bytes\n", options.out.c_str(), file.size());
}

}  // namespace

void add_glow_table(CLI::App& program) {
  auto options = std::make_shared<Options>();
  CLI::App* command = program.add_subcommand(
      "glow-table",
      "Build the glow table from the transfer equation's solution (no random numbers; some minutes)");
  command->add_option("OUT", options->out, "The file to write")->required();
  command->add_option("--threads", options->threads, "Threads; 0 for one per core")->capture_default_str();
  const auto nodes = CLI::Range(4, 120);
  command->add_option("--albedo-nodes", options->grid.albedo_nodes, "Grid in the albedo")
      ->check(nodes)
      ->capture_default_str();
  // Two nodes beyond each end must be where there is a solution: q up to 0.98, an angle below 180°.
  command->add_option("--q-nodes", options->grid.q_nodes, "Grid in q")
      ->check(CLI::Range(19, 120))
      ->capture_default_str();
  command->add_option("--thickness-nodes", options->grid.thickness_nodes, "Grid in ln T")
      ->check(nodes)
      ->capture_default_str();
  command->add_option("--theta-nodes", options->grid.theta_nodes, "Grid in ln theta")
      ->check(CLI::Range(28, 120))
      ->capture_default_str();
  command->footer("Example:\n  lampglow glow-table estimator/scattering/glow_table.bin");
  command->callback([options] { run(*options); });
}

}  // namespace lampglow::daemon
