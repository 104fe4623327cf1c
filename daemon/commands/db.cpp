#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/commands/database.h"
#include "daemon/errors.h"
#include "storage/maintenance.h"

namespace lampglow::daemon {
namespace {

void check_database(const std::string& file) {
  needs_database(file);
  with_storage_errors([&] {
    const std::string found = storage::check(file, true);
    if (found != "ok") throw DataError(file + ": integrity check failed:\n" + found);
    std::printf("%s: ok\n", file.c_str());
  });
}

void backup_database(const std::string& file, const std::string& copy) {
  needs_database(file);
  std::error_code unknown;  // then making it says why
  if (std::filesystem::exists(copy, unknown))
    throw UsageError(copy + ": is there already; it will not be overwritten");
  with_storage_errors([&] { storage::backup(file, copy); });
  std::printf("wrote %s, checked\n", copy.c_str());
}

void vacuum_database(const std::string& file) {
  needs_database(file);
  std::error_code unknown;
  const auto before = std::filesystem::file_size(file, unknown);
  with_storage_errors([&] { storage::vacuum(file); });
  std::printf("%s: %ju bytes, before %ju\n", file.c_str(), std::filesystem::file_size(file, unknown), before);
}

}  // namespace

void add_db(CLI::App& program) {
  CLI::App* command = program.add_subcommand("db", "Look after a database: check, backup, vacuum");
  command->require_subcommand(1);
  auto file = std::make_shared<std::string>(), copy = std::make_shared<std::string>();
  const auto part = [&](const char* name, const char* help, const std::string& example) {
    CLI::App* sub = command->add_subcommand(name, help);
    sub->add_option("FILE", *file, "The database")->required();
    sub->footer("Example:\n  lampglow db " + example);
    return sub;
  };
  part("check", "Run SQLite's integrity check", "check /var/lib/lampglow/lampglow.db")->callback([file] {
    check_database(*file);
  });
  CLI::App* backup = part("backup", "Copy a database, in use or not, and check the copy",
                          "backup /var/lib/lampglow/lampglow.db /mnt/usb/lampglow.db");
  backup->add_option("COPY", *copy, "The file to make")->required();
  backup->callback([file, copy] { backup_database(*file, *copy); });
  part("vacuum", "Rewrite the file without free space, in the present schema; stop the station first",
       "vacuum /var/lib/lampglow/lampglow.db")
      ->callback([file] { vacuum_database(*file); });
  command->footer("Example:\n  lampglow db check /var/lib/lampglow/lampglow.db");
}

}  // namespace lampglow::daemon
