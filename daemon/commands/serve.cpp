#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/station/station.h"

namespace lampglow::daemon {

void add_serve(CLI::App& program) {
  CLI::App* command =
      program.add_subcommand("serve", "Run the station: cameras in, observations out over HTTP");
  auto file = std::make_shared<std::string>("/etc/lampglow/lampglow.toml");
  command->add_option("--config", *file, "The configuration")->type_name("FILE")->capture_default_str();
  command->footer(
      "Example:\n  lampglow serve --config /etc/lampglow/lampglow.toml\n\n"
      "SIGHUP reads the configuration again, SIGTERM ends. /usr/share/doc/lampglow/station.md tells the "
      "rest.");
  command->callback([file] { serve(*file); });
}

}  // namespace lampglow::daemon
