#include <CLI/CLI.hpp>
#include <cstdio>

#include "daemon/commands/commands.h"
#include "daemon/errors.h"

int main(int argc, char** argv) {
  CLI::App program{"lampglow measures visibility from the glow of street lights in a camera's picture."};
  program.require_subcommand(1);
  lampglow::daemon::add_commands(program);
  try {
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return program.exit(error) == 0 ? 0 : lampglow::daemon::kExitUsage;
  } catch (const lampglow::daemon::CommandError& error) {
    std::fprintf(stderr, "lampglow: %s\n", error.what());
    return error.exit_code();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "lampglow: internal error: %s\n", error.what());
    return lampglow::daemon::kExitInternal;
  }
  return 0;
}
