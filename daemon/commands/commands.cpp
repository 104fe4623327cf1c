#include "daemon/commands/commands.h"

namespace lampglow::daemon {

void add_commands(CLI::App& program) {
  add_replay(program);
  add_check_config(program);
  add_simulate(program);
  add_glow(program);
  add_render(program);
  add_glow_table(program);
  add_validate(program);
  add_survey(program);
  add_probe(program);
  add_calibrate(program);
  add_calibrate_response(program);
  add_serve(program);
  add_export(program);
  add_db(program);
  add_reference(program);
  add_token(program);
  add_version(program);
  add_man(program);
}

}  // namespace lampglow::daemon
