// The man pages and the shell completion, from the same descriptions as --help.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "daemon/commands/commands.h"
#include "daemon/config/files.h"
#include "daemon/errors.h"
#include "estimator/quality.h"

namespace lampglow::daemon {
namespace {

// Text as roff: no line may begin with a control character, and a hyphen is a hyphen.
std::string roff(const std::string& text) {
  std::string out;
  bool line_start = true;
  for (const char c : text) {
    if (line_start && (c == '.' || c == '\'')) out += "\\&";
    if (c == '\\')
      out += "\\e";
    else if (c == '-')
      out += "\\-";
    else
      out += c;
    line_start = c == '\n';
  }
  return out;
}

std::vector<const CLI::App*> visible_commands(const CLI::App& program) {
  auto commands = program.get_subcommands([](const CLI::App* app) { return !app->get_group().empty(); });
  return {commands.begin(), commands.end()};
}

std::string synopsis(const CLI::App& command) {
  std::string text = visible_commands(command).empty() ? "" : " \\fIcommand\\fR";
  for (const CLI::Option* option : command.get_options())
    if (option->get_positional()) text += fmt::format(" \\fI{}\\fR", roff(option->get_name(true, false)));
  return text + " [\\fIoptions\\fR]";
}

std::string options_list(const CLI::App& command) {
  std::string text;
  for (const CLI::Option* option : command.get_options()) {
    const std::string name =
        option->get_positional() ? option->get_name(true, false) : option->get_name(false, true);
    const std::string value = option->get_positional() || option->get_items_expected_max() == 0
                                  ? ""
                                  : " \\fI" + roff(option->get_type_name()) + "\\fR";
    text += fmt::format(".TP\n\\fB{}\\fR{}\n{}", roff(name), value, roff(option->get_description()));
    if (!option->get_default_str().empty()) text += roff(" (default: " + option->get_default_str() + ")");
    text += "\n";
  }
  return text;
}

std::string options_section(const CLI::App& command) {
  const std::string text = options_list(command);
  return text.empty() ? "" : ".SH OPTIONS\n" + text;
}

// `db` has commands of its own, with options of their own.
std::string subcommands_section(const CLI::App& command) {
  std::string text;
  for (const CLI::App* part : visible_commands(command))
    text += fmt::format(".TP\n\\fB{}\\fR{}\n{}\n.RS\n{}.RE\n", roff(part->get_name()), synopsis(*part),
                        roff(part->get_description()), options_list(*part));
  return text.empty() ? "" : ".SH COMMANDS\n" + text;
}

std::string footer_section(const CLI::App& command) {
  const std::string footer = command.get_footer();
  constexpr std::string_view kTitle = "Example:\n";
  if (footer.empty()) return "";
  const std::string body = footer.starts_with(kTitle) ? footer.substr(kTitle.size()) : footer;
  return ".SH EXAMPLE\n.nf\n" + roff(body) + "\n.fi\n";
}

std::string exit_section() {
  return ".SH EXIT STATUS\n0 done; 64 bad usage; 65 bad data; 70 internal error; 74 input or output failed; "
         "78 bad "
         "configuration or site file; 130 or 143 ended by SIGINT or SIGTERM before the work was done\n";
}

std::string files_section() {
  return ".SH FILES\n.TP\n/etc/lampglow/lampglow.toml\nthe station's configuration; every key is explained "
         "in "
         "/usr/share/doc/lampglow/configuration.md\n.TP\n/var/lib/lampglow\ndatabase, kept pictures, "
         "backups\n"
         ".TP\n/usr/share/doc/lampglow\nwhat the station does when, the HTTP interface, how to mount and "
         "calibrate "
         "a camera\n";
}

std::string program_page(const CLI::App& program) {
  std::string text = ".TH LAMPGLOW 1 \"\" \"lampglow " LAMPGLOW_VERSION "\"\n.SH NAME\nlampglow \\- " +
                     roff("visibility from the glow of street lights") +
                     "\n.SH SYNOPSIS\n\\fBlampglow\\fR \\fIcommand\\fR [\\fIoptions\\fR]\n.SH DESCRIPTION\n" +
                     roff(program.get_description()) + "\n.SH COMMANDS\n";
  for (const CLI::App* command : visible_commands(program))
    text += fmt::format(".TP\n\\fB{}\\fR\n{}; see \\fBlampglow\\-{}\\fR(1)\n", roff(command->get_name()),
                        roff(command->get_description()), roff(command->get_name()));
  return text + options_section(program) + exit_section() + files_section();
}

std::string command_page(const CLI::App& command) {
  const std::string name = "lampglow-" + command.get_name();
  std::string title = name;
  std::transform(title.begin(), title.end(), title.begin(), [](unsigned char c) { return std::toupper(c); });
  return fmt::format(
             ".TH {} 1 \"\" \"lampglow {}\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n\\fBlampglow {}\\fR{}\n",
             roff(title), LAMPGLOW_VERSION, roff(name), roff(command.get_description()),
             roff(command.get_name()), synopsis(command)) +
         subcommands_section(command) + options_section(command) + footer_section(command) + exit_section() +
         ".SH SEE ALSO\n\\fBlampglow\\fR(1)\n";
}

std::string long_options(const CLI::App& command) {
  std::string text;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) text += (text.empty() ? "--" : " --") + name;
  return text;
}

std::string names_of(const CLI::App& program) {
  std::string names;
  for (const CLI::App* command : visible_commands(program))
    names += (names.empty() ? "" : " ") + command->get_name();
  return names;
}

// The words that an option takes, of its type's name "TEXT:{csv,json}"; empty if it takes others.
std::string choices_of(const CLI::Option& option) {
  const std::string type = option.get_type_name();
  const std::size_t begin = type.find('{'), end = type.find('}');
  if (begin == std::string::npos || end == std::string::npos) return "";
  std::string words = type.substr(begin + 1, end - begin - 1);
  std::replace(words.begin(), words.end(), ',', ' ');
  return words;
}

// What may follow the command's words, and what an option's value may be.
std::string completion_cases(const CLI::App& command, const std::string& words) {
  std::string text;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames())
      if (const std::string choices = choices_of(*option); !choices.empty())
        text += fmt::format("    \"{} \"*\"--{} \") values=\"{}\" ;;&\n", words, name, choices);
  for (const CLI::App* part : visible_commands(command))
    text += completion_cases(*part, words + " " + part->get_name());
  return text + fmt::format("    \"{} \"*) options=\"{}\" names=\"{}\" ;;\n", words, long_options(command),
                            names_of(command));
}

// $line: the words before the current one. The first is a command; after it come its own commands
// (`db check`), options and files. Where an option takes but a few words, these.
std::string bash_completion(const CLI::App& program) {
  std::string cases;
  for (const CLI::App* command : visible_commands(program))
    cases += completion_cases(*command, command->get_name());
  return "# bash completion of lampglow; made by `lampglow man --completion`\n_lampglow() {\n"
         "  local current=\"${COMP_WORDS[COMP_CWORD]}\" options=\"\" names=\"\" values=\"\"\n"
         "  local line=\"${COMP_WORDS[*]:1:COMP_CWORD-1}\"\n"
         "  case \"$line \" in\n"
         "    \" \") options=\"--help\" names=\"" +
         names_of(program) + "\" ;;\n" + cases +
         "  esac\n"
         "  case \"$current\" in\n"
         "    -*) COMPREPLY=($(compgen -W \"$options\" -- \"$current\")) ;;\n"
         "    *)\n"
         "      COMPREPLY=($(compgen -W \"${values:-$names}\" -- \"$current\"))\n"
         "      [ \"$COMP_CWORD\" -eq 1 ] || [ -n \"$values\" ] || COMPREPLY+=($(compgen -f -- "
         "\"$current\")) ;;\n"
         "  esac\n}\n"
         "complete -o filenames -F _lampglow lampglow\n";
}

// docs/quality-flags.md: the registry as a table.
std::string quality_flags_page() {
  std::string text =
      "# Quality flags\n\nWritten by `lampglow man --quality-flags` from `estimator/quality.cpp`, the one "
      "registry that "
      "the\nCSV, the database and the HTTP answers use. A flag's bit and name never change their meaning.\n\n"
      "| bit | flag | meaning |\n|---|---|---|\n";
  for (const QualityFlag& entry : quality_registry())
    text += fmt::format("| {} | `{}` | {} |\n", static_cast<unsigned>(entry.flag), entry.name, entry.meaning);
  return text;
}

void write_pages(const CLI::App& program, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  write_file_atomically(folder / "lampglow.1", program_page(program));
  for (const CLI::App* command : visible_commands(program))
    write_file_atomically(folder / ("lampglow-" + command->get_name() + ".1"), command_page(*command));
}

}  // namespace

void add_man(CLI::App& program) {
  CLI::App* command = program.add_subcommand("man", "Print the man page of the program or of one command");
  command->group("");  // for packagers; not in the help's list
  auto topic = std::make_shared<std::string>();
  auto folder = std::make_shared<std::string>();
  auto completion = std::make_shared<bool>(false);
  auto flags = std::make_shared<bool>(false);
  command->add_option("COMMAND", *topic, "The command whose page is wanted");
  command->add_option("--directory", *folder, "Write all pages into this folder");
  command->add_flag("--completion", *completion, "Print the bash completion instead");
  command->add_flag("--quality-flags", *flags, "Print the documentation of the quality flags instead");
  command->footer("Example:\n  lampglow man replay | man -l -");
  command->callback([&program, topic, folder, completion, flags] {
    if (*flags) {
      fmt::print("{}", quality_flags_page());
    } else if (*completion) {
      fmt::print("{}", bash_completion(program));
    } else if (!folder->empty()) {
      write_pages(program, *folder);
    } else if (topic->empty()) {
      fmt::print("{}", program_page(program));
    } else {
      for (const CLI::App* candidate : visible_commands(program))
        if (candidate->get_name() == *topic) return fmt::print("{}", command_page(*candidate));
      throw UsageError("man: expected a command's name, got \"" + *topic + "\"");
    }
  });
}

}  // namespace lampglow::daemon
