// The program's commands, one .cpp file each. Every function adds its command to the program with help and
// callback.
#pragma once

namespace CLI {
class App;
}

namespace lampglow::daemon {

void add_calibrate_response(CLI::App& program);
void add_check_config(CLI::App& program);
void add_glow(CLI::App& program);
void add_glow_table(CLI::App& program);
void add_man(CLI::App& program);
void add_render(CLI::App& program);
void add_replay(CLI::App& program);
void add_simulate(CLI::App& program);
void add_calibrate(CLI::App& program);
void add_survey(CLI::App& program);
void add_validate(CLI::App& program);
void add_probe(CLI::App& program);
void add_serve(CLI::App& program);
void add_export(CLI::App& program);
void add_db(CLI::App& program);
void add_reference(CLI::App& program);
void add_token(CLI::App& program);
void add_version(CLI::App& program);

// All of the above, in the order in which the help shows them.
void add_commands(CLI::App& program);

}  // namespace lampglow::daemon
