// Runs the real program and keeps what it said.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/temporary_folder.h"

namespace lampglow::test {

struct ProgramRun {
  int exit_code = -1;
  std::string out, err;
};

inline std::string shell_quoted(const std::string& text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

inline ProgramRun run_program(const std::vector<std::string>& arguments) {
  const TemporaryFolder folder;
  std::string command = shell_quoted(LAMPGLOW_BINARY);
  for (const std::string& argument : arguments) command += " " + shell_quoted(argument);
  command += " >" + shell_quoted((folder.path() / "out").string()) + " 2>" +
             shell_quoted((folder.path() / "err").string()) + " </dev/null";
  const int status = std::system(command.c_str());
  return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, read_all(folder.path() / "out"),
          read_all(folder.path() / "err")};
}

}  // namespace lampglow::test
