#include <CLI/CLI.hpp>
#include <cstdio>

#include "daemon/commands/commands.h"

namespace lampglow::daemon {

void add_version(CLI::App& program) {
  CLI::App* command = program.add_subcommand("version", "Print the version");
  command->footer("Example:\n  lampglow version");
  command->callback([] { std::puts("lampglow " LAMPGLOW_VERSION); });
}

}  // namespace lampglow::daemon
