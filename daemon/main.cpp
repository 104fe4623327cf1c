#include <CLI/CLI.hpp>
#include <cstdio>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/config/config_file.h"
#include "daemon/errors.h"

namespace {

// What was printed must have arrived: a full disk behind a pipe is an error, not silence.
int flush_output() {
  if (std::fflush(stdout) == 0 && !std::ferror(stdout)) return 0;
  std::perror("lampglow: standard output");
  return lampglow::daemon::kExitIo;
}

// A command that does not exist is told by its name; CLI11 only says that one is required.
void refuse_unknown_command(const CLI::App& program, int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') return;
  const std::string asked = argv[1];
  std::vector<std::string> known;
  for (const CLI::App* command : program.get_subcommands([](const CLI::App*) { return true; }))
    known.push_back(command->get_name());
  for (const std::string& name : known)
    if (name == asked) return;
  const auto near = lampglow::daemon::nearest_key(asked, known);
  throw lampglow::daemon::UsageError("no command \"" + asked + "\"" +
                                     (near ? "; did you mean " + *near + "?" : "") +
                                     "\nRun with --help for more information.");
}

}  // namespace

int main(int argc, char** argv) {
  using namespace lampglow::daemon;
  CLI::App program{"lampglow measures visibility from the glow of street lights in a camera's picture.",
                   "lampglow"};
  program.require_subcommand(1);
  program.footer("Example:\n  lampglow replay archive --csv out.csv\n\nEvery command has its own --help.");
  cv::setNumThreads(
      1);  // frames are worked on in parallel already; OpenCV's own threads would spin beside them
  try {
    add_commands(program);
    refuse_unknown_command(program, argc, argv);
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
