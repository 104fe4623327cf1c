#include "daemon/commands/commands.h"

namespace lampglow::daemon {

void add_commands(CLI::App& program) {
  add_version(program);
}

}  // namespace lampglow::daemon
