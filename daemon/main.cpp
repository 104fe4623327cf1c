#include <CLI/CLI.hpp>
#include <cstdio>

#include "daemon/commands/commands.h"
#include "daemon/errors.h"

namespace {

// What was printed must have arrived: a full disk behind a pipe is an error, not silence.
int flush_output() {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return 0;
  std::perror("lampglow: standard output");
  return lampglow::daemon::kExitIo;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace lampglow::daemon;
  CLI::App program{"lampglow measures visibility from the glow of street lights in a camera's picture.",
                   "lampglow"};
  program.require_subcommand(1);
  program.footer("Example:\n  lampglow replay archive --csv out.csv\n\nEvery command has its own --help.");
  try {
    add_commands(program);
    program.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return program.exit(error) == 0 ? flush_output() : kExitUsage;
  } catch (const CommandError& error) {
    std::fprintf(stderr, "lampglow: %s\n", error.what());
    return error.exit_code();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "lampglow: internal error: %s\n", error.what());
    return kExitInternal;
  }
  return flush_output();
}
