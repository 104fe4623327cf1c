#include <CLI/CLI.hpp>
#include <cstdio>

#include "daemon/commands/commands.h"
#include "web/tokens.h"

namespace lampglow::daemon {

void add_token(CLI::App& program) {
  CLI::App* command = program.add_subcommand("token", "Make a bearer token for the HTTP interface");
  command->footer(
      "Example:\n  lampglow token\n\nGive the token to the client and put the hash into the configuration: "
      "[http] token_hashes.");
  command->callback([] {
    const std::string token = web::new_token();
    std::printf("token: %s\nhash:  %s\n", token.c_str(), web::token_hash(token).c_str());
  });
}

}  // namespace lampglow::daemon
