#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "daemon/commands/commands.h"
#include "daemon/errors.h"
#include "storage/maintenance.h"

namespace lampglow::daemon {
namespace {

void needs_file(const std::string& file) {
  if (!std::filesystem::is_regular_file(file)) throw IoError(file + ": there is no such database");
}

void with_errors(const std::function<void()>& work) {
  try {
    work();
  } catch (const storage::StorageError& error) {
    using Kind = storage::StorageError::Kind;
    if (error.kind() == Kind::corrupt || error.kind() == Kind::too_new) throw DataError(error.what());
    throw IoError(error.what());
  }
}

void check_database(const std::string& file) {
  needs_file(file);
  with_errors([&] {
    const std::string found = storage::check(file, true);
    if (found != "ok") throw DataError(file + ": integrity check failed:\n" + found);
    std::printf("%s: ok\n", file.c_str());
  });
}

void backup_database(const std::string& file, const std::string& copy) {
  needs_file(file);
  if (std::filesystem::exists(copy))
    throw UsageError(copy + ": is there already; it will not be overwritten");
  with_errors([&] { storage::backup(file, copy); });
  std::printf("wrote %s, checked\n", copy.c_str());
}

void vacuum_database(const std::string& file) {
  needs_file(file);
  const auto before = std::filesystem::file_size(file);
  with_errors([&] { storage::vacuum(file); });
  std::printf("%s: %ju bytes, before %ju\n", file.c_str(), std::filesystem::file_size(file), before);
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
  part("vacuum", "Rewrite the file without free space; stop the station first",
       "vacuum /var/lib/lampglow/lampglow.db")
      ->callback([file] { vacuum_database(*file); });
  command->footer("Example:\n  lampglow db check /var/lib/lampglow/lampglow.db");
}

}  // namespace lampglow::daemon
