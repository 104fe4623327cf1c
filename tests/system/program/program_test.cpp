// The program as its user meets it: messages, exit codes, files.
#include <gmock/gmock.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <regex>
#include <sstream>
#include <thread>

#include "estimator/observation_csv.h"
#include "storage/reader.h"
#include "tests/support/run_program.h"
#include "tests/support/small_archive.h"

namespace lampglow {
namespace {

using test::encoded;
using test::ProgramRun;
using test::read_all;
using test::run_program;
using test::small_picture;
using test::small_site;
using test::TemporaryFolder;
using testing::HasSubstr;

// Frames a minute apart, of which some are bad: one missing, cut off, of wrong size, a bomb.
void write_archive(const TemporaryFolder& folder, int frames) {
  folder.write("site.toml", small_site(8));
  const std::string good = encoded(small_picture(CV_8UC1), ".png");
  folder.write("images/good.png", good);
  folder.write("images/cut.png", good.substr(0, 150));
  folder.write("images/small.png", encoded(cv::Mat(40, 60, CV_8UC1, cv::Scalar(1)), ".png"));
  std::string bomb = good;
  for (const int at : {16, 20}) bomb.replace(static_cast<std::size_t>(at), 4, std::string("\0\0\x4E\x20", 4));
  folder.write("images/bomb.png", bomb);
  const std::vector<std::string> bad{"gone.png", "cut.png", "small.png", "bomb.png"};
  std::string csv = test::kFramesHeader;
  for (int i = 0; i < frames; ++i) {
    char time[32];
    std::snprintf(time, sizeof time, "2026-01-01T%02d:%02d:00Z", i / 60, i % 60);
    const std::string name = i >= 2 && i < 6 ? bad[static_cast<std::size_t>(i - 2)] : "good.png";
    csv += std::string(time) + ",images/" + name + ",0.1,0," +
           (i < 1 ? "clear_reference,30000\n" : "observation,\n");
  }
  folder.write("frames.csv", csv);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST(Program, BadUsageExits64WithAMessage) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{},
                                                    {"fly"},
                                                    {"replay"},
                                                    {"replay", "--wrokers", "2", "x"},
                                                    {"replay", "x", "--workers", "0"},
                                                    {"replay", "x", "--workers", "many"},
                                                    {"check-config"}}) {
    const ProgramRun run = run_program(arguments);
    EXPECT_EQ(run.exit_code, 64);
    EXPECT_THAT(run.err, HasSubstr("--help"));
    EXPECT_EQ(run.out, "");
  }
}

TEST(Program, AMistypedCommandIsToldWithTheNearest) {
  EXPECT_EQ(run_program({"reply", "x"}).err,
            "lampglow: no command \"reply\"; did you mean replay?\nRun with --help for more information.\n");
  EXPECT_THAT(run_program({"simulate", "x", "--style", "film"}).err,
              HasSubstr("film not in {bracket,webcam}"));
}

TEST(Program, RenderKeepsADepthAndSqueezesNoFloatIntoIntegers) {
  const TemporaryFolder folder;
  const auto render = [&](const std::string& in, const std::string& out) {
    return run_program({"render", (folder.path() / in).string(), (folder.path() / out).string(), "--mor",
                        "300", "--q", "0.9", "--distance", "100"});
  };
  folder.write("real.tiff", encoded(cv::Mat(48, 64, CV_32FC1, cv::Scalar(0.5)), ".tiff"));
  const ProgramRun refused = render("real.tiff", "out.png");
  EXPECT_EQ(refused.exit_code, 64);
  EXPECT_THAT(refused.err, HasSubstr("out.png: a float picture is written as .exr or .tiff"));
  folder.write("deep.png", encoded(small_picture(CV_16UC1), ".png"));
  for (const auto& [in, out, type] :
       {std::tuple{"real.tiff", "out.tiff", CV_32F}, {"deep.png", "out.png", CV_16U}}) {
    EXPECT_EQ(render(in, out).exit_code, 0) << out;
    EXPECT_EQ(cv::imread((folder.path() / out).string(), cv::IMREAD_UNCHANGED).depth(), type) << out;
  }
}

TEST(Program, WhatCannotBeWrittenIsToldBeforeTheWork) {
  for (const char* command : {"validate", "glow-table"}) {
    const ProgramRun run = run_program({command, "/no/such/folder/out"});
    EXPECT_EQ(run.exit_code, 74) << command;
    EXPECT_THAT(run.err, HasSubstr("/no/such/folder/out")) << command;
  }
}

TEST(Program, EveryCommandHasHelpWithAnExampleAndAManPage) {
  const std::string help = run_program({"--help"}).out;
  const TemporaryFolder folder;
  ASSERT_EQ(run_program({"man", "--directory", folder.path().string()}).exit_code, 0);
  int commands = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
    const std::string name = entry.path().stem().string();
    if (!name.starts_with("lampglow-")) continue;
    ++commands;
    const std::string command = name.substr(9);
    EXPECT_THAT(help, HasSubstr("\n  " + command));
    const ProgramRun run = run_program({command, "--help"});
    EXPECT_EQ(run.exit_code, 0);
    EXPECT_THAT(run.out, testing::ContainsRegex("Examples?:\n  lampglow " + command)) << command;
    EXPECT_THAT(read_all(entry.path()), HasSubstr(".SH EXAMPLE")) << command;
  }
  EXPECT_GE(commands, 4);
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "lampglow.1"));
}

TEST(Program, TheShellCompletesCommandsOptionsAndFiles) {
  const TemporaryFolder folder;
  folder.write("completion", run_program({"man", "--completion"}).out);
  folder.write("archive.toml", "");
  const auto completed = [&](const std::string& words, int current) {
    const std::string script = "cd '" + folder.path().string() + "' && . ./completion && COMP_WORDS=(" +
                               words + ") COMP_CWORD=" + std::to_string(current) +
                               "; _lampglow; echo \"${COMPREPLY[*]}\" > out";
    EXPECT_EQ(std::system(("bash -c " + test::shell_quoted(script)).c_str()), 0);
    return read_all(folder.path() / "out");
  };
  EXPECT_EQ(completed("lampglow rep", 1), "replay\n");
  EXPECT_EQ(completed("lampglow replay --w", 2), "--workers\n");
  EXPECT_EQ(completed("lampglow replay arch", 2), "archive.toml\n");
  EXPECT_EQ(completed("lampglow db ch", 2), "check\n");
  EXPECT_EQ(completed("lampglow reference list x.db --c", 4), "--camera\n");
  EXPECT_EQ(completed("lampglow db check arch", 3), "archive.toml\n");
  EXPECT_EQ(completed("lampglow export x.db --format ''", 4), "csv json\n");
  EXPECT_EQ(completed("lampglow export x.db --step 1", 4), "1min 10min\n");
  EXPECT_EQ(completed("lampglow export x.db --step hour arch", 5), "archive.toml\n");
}

// The first words of a help's section: the commands, or the long options of any line.
std::vector<std::string> named_in(const std::string& help, const std::regex& name) {
  std::vector<std::string> names;
  for (std::sregex_iterator found(help.begin(), help.end(), name), end; found != end; ++found)
    names.push_back((*found)[1]);
  return names;
}

// Down through the commands' commands: what `--help` tells, the man page and the shell must know, too.
void expect_documented(const TemporaryFolder& folder, const std::vector<std::string>& words, int& options) {
  std::vector<std::string> arguments = words;
  arguments.push_back("--help");
  const std::string help = run_program(arguments).out;
  const std::string page = words.empty() ? "lampglow.1" : "lampglow-" + words.front() + ".1";
  const std::string man = read_all(folder.path() / page);
  std::string line = "lampglow";
  for (const std::string& word : words) line += " " + word;
  const auto completed = [&](const std::string& current) {
    const std::string script = ". '" + (folder.path() / "completion").string() + "' && COMP_WORDS=(" + line +
                               " " + current + ") COMP_CWORD=" + std::to_string(words.size() + 1) +
                               "; _lampglow; printf '%s\\n' \"${COMPREPLY[@]}\" > '" +
                               (folder.path() / "out").string() + "'";
    EXPECT_EQ(std::system(("bash -c " + test::shell_quoted(script)).c_str()), 0);
    return lines_of(read_all(folder.path() / "out"));
  };
  for (const std::string& option : named_in(help, std::regex("\n  (?:-[a-z],)?(--[a-z0-9-]+)"))) {
    ++options;
    EXPECT_THAT(completed("--"), testing::Contains(option)) << line;
    EXPECT_THAT(man, HasSubstr(std::regex_replace(option, std::regex("-"), "\\-"))) << line;
  }
  const std::size_t commands = help.find("\nSubcommands:\n");
  if (commands == std::string::npos) return;
  for (const std::string& command : named_in(help.substr(commands, help.find("\n\n", commands) - commands),
                                             std::regex("\n  ([a-z-]+) "))) {
    EXPECT_THAT(completed(command.substr(0, 2)), testing::Contains(command)) << line;
    EXPECT_THAT(man, HasSubstr("\\fB" + std::regex_replace(command, std::regex("-"), "\\-") + "\\fR"))
        << line;
    std::vector<std::string> deeper = words;
    deeper.push_back(command);
    expect_documented(folder, deeper, options);
  }
}

TEST(Program, EveryOptionOfEveryCommandHasItsManPageAndIsCompleted) {
  const TemporaryFolder folder;
  ASSERT_EQ(run_program({"man", "--directory", folder.path().string()}).exit_code, 0);
  folder.write("completion", run_program({"man", "--completion"}).out);
  int options = 0;
  expect_documented(folder, {}, options);
  EXPECT_GT(options, 100);
}

TEST(Program, TheDocumentedQualityFlagsAreTheRegistrys) {
  EXPECT_EQ(read_all(std::filesystem::path(LAMPGLOW_SOURCE_DIR) / "docs/quality-flags.md"),
            run_program({"man", "--quality-flags"}).out)
      << "renew it: lampglow man --quality-flags > docs/quality-flags.md";
}

TEST(Program, ABadSiteFileExits78WithEveryMistake) {
  const TemporaryFolder folder;
  std::string site = small_site(8);
  site.replace(site.find("width_px"), 8, "widht_px");
  site.replace(site.find("\"linear\""), 8, "\"../curve.csv\"");
  const auto file = folder.write("site.toml", site);
  const ProgramRun run = run_program({"check-config", file.string()});
  EXPECT_EQ(run.exit_code, 78);
  EXPECT_THAT(run.err,
              HasSubstr(file.string() + ":7:1: camera.widht_px: unknown key; did you mean width_px?"));
  EXPECT_THAT(run.err,
              HasSubstr(file.string() + ":13:12: camera.response: expected \"linear\", \"srgb\" or"));
}

TEST(Program, ABadConfigurationOfTheDaemonExits78WithEveryMistake) {
  const TemporaryFolder folder;
  folder.write("site.toml", small_site(8));
  const auto file = folder.write("station.toml",
                                 "site_file = \"site.toml\"\n[source]\nurl = \"ftp://camera\"\n"
                                 "[schedule]\nintervall_s = 60\n[http]\nport = 70000\n");
  const ProgramRun run = run_program({"check-config", file.string()});
  EXPECT_EQ(run.exit_code, 78);
  EXPECT_THAT(run.err, HasSubstr(file.string() + ":3:7: source.url: expected"));
  EXPECT_THAT(run.err, HasSubstr(file.string() + ":5:1: schedule.intervall_s: unknown key; did you mean"));
  EXPECT_THAT(run.err, HasSubstr(file.string() + ":7:8: http.port: expected"));
}

TEST(Program, ABadArchiveExits65) {
  const TemporaryFolder folder;
  ProgramRun run = run_program({"replay", (folder.path() / "none").string()});
  EXPECT_EQ(run.exit_code, 65);
  EXPECT_THAT(run.err,
              HasSubstr("none: expected an archive, a folder with site.toml, frames.csv and images/"));
  run = run_program({"replay", folder.path().string()});
  EXPECT_EQ(run.exit_code, 65);
  EXPECT_THAT(run.err, HasSubstr("frames.csv: an archive needs this file"));
  write_archive(folder, 3);
  folder.write("frames.csv", std::string(test::kFramesHeader) + "noon,../x.png,,,observation,\n");
  run = run_program({"replay", folder.path().string()});
  EXPECT_EQ(run.exit_code, 65);
  EXPECT_THAT(run.err, HasSubstr("frames.csv:2:1: time_utc: expected a time such as"));
  EXPECT_THAT(run.err, HasSubstr("frames.csv:2:6: file: expected a path within the archive"));
  folder.write("truth.csv", "time_utc,mor_m\n2026-01-01T00:00:00Z,far\n");
  run = run_program({"replay", folder.path().string(), "--truth", (folder.path() / "truth.csv").string()});
  EXPECT_EQ(run.exit_code, 65);
  EXPECT_THAT(run.err, HasSubstr("truth.csv:2:22: mor_m: expected nothing or a number"));
}

TEST(Program, BadFramesAreFlaggedRecordsAndTheRunGoesOn) {
  const TemporaryFolder folder;
  write_archive(folder, 8);
  const auto csv = folder.path() / "out.csv";
  const ProgramRun run = run_program({"replay", folder.path().string(), "--csv", csv.string()});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const auto lines = lines_of(read_all(csv));
  ASSERT_EQ(lines.size(), 9U);
  EXPECT_EQ(lines[0], kObservationCsvHeader);
  EXPECT_THAT(lines[3], HasSubstr("frame_missing"));
  EXPECT_THAT(lines[4], HasSubstr("frame_truncated"));
  EXPECT_THAT(lines[5], HasSubstr("frame_wrong_size"));
  EXPECT_THAT(lines[6], HasSubstr("frame_too_large"));
  EXPECT_THAT(run.err, HasSubstr("warning: 2026-01-01T00:02:00Z: images/gone.png: No such file"));
  EXPECT_THAT(run.out, HasSubstr("8 of 8 frames done"));
  EXPECT_THAT(run.out, HasSubstr("4 bad frames"));
}

TEST(Program, OneAndSeveralWorkersGiveTheSameBytes) {
  const TemporaryFolder folder;
  write_archive(folder, 30);
  std::vector<std::string> csv, content;
  for (const std::string workers : {"1", "2", "4"}) {
    const auto table = folder.path() / (workers + ".csv"), database = folder.path() / (workers + ".db");
    const ProgramRun run = run_program({"replay", folder.path().string(), "--workers", workers, "--csv",
                                        table.string(), "--db", database.string()});
    ASSERT_EQ(run.exit_code, 0) << run.err;
    csv.push_back(read_all(table));
    content.push_back(storage::Reader(database).content());
  }
  EXPECT_EQ(csv[0], csv[1]);
  EXPECT_EQ(csv[0], csv[2]);
  EXPECT_EQ(content[0], content[1]);
  EXPECT_EQ(content[0], content[2]);
  EXPECT_GT(content[0].size(), 1000U);
}

TEST(Program, ScoresGoBesideTheCsvAndTheReportStandsAlone) {
  const TemporaryFolder folder;
  write_archive(folder, 8);
  folder.write("truth.csv", "time_utc,mor_m,role\n2026-01-01T00:07:00Z,500,x\n");
  const ProgramRun run = run_program(
      {"replay", folder.path().string(), "--truth", (folder.path() / "truth.csv").string(), "--csv",
       (folder.path() / "out.csv").string(), "--report", (folder.path() / "out.html").string()});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("1 records have a truth"));
  EXPECT_THAT(read_all(folder.path() / "out.scores.json"), HasSubstr("\"pairs\":1"));
  const std::string report = read_all(folder.path() / "out.html");
  EXPECT_THAT(report, HasSubstr("<svg"));
  EXPECT_THAT(report, HasSubstr("data:image/jpeg;base64,/9j/"));
  EXPECT_THAT(report, HasSubstr("prefers-color-scheme: dark"));
  for (const char* outside : {"src=\"http", "href=\"http", "@import", "url("})
    EXPECT_THAT(report, testing::Not(HasSubstr(outside)));
}

TEST(Program, JsonIsAllThatIsPrinted) {
  const TemporaryFolder folder;
  write_archive(folder, 3);
  const ProgramRun run = run_program({"replay", folder.path().string(), "--json"});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(run.out.front(), '{');
  EXPECT_EQ(run.out.substr(run.out.size() - 2), "}\n");
}

// Starts the program, presses Ctrl-C once `sign` exists, and waits for its end. Returns waitpid's status.
int interrupted_run(std::vector<std::string> arguments, const std::filesystem::path& sign) {
  std::vector<char*> argv{const_cast<char*>(LAMPGLOW_BINARY)};
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  const pid_t child = ::fork();
  if (child == 0) {
    ::freopen("/dev/null", "w", stdout);
    ::freopen("/dev/null", "w", stderr);
    ::execv(LAMPGLOW_BINARY, argv.data());
    ::_exit(127);
  }
  for (int i = 0; i < 6000 && !std::filesystem::exists(sign); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ::kill(child, SIGINT);
  int status = 0;
  ::waitpid(child, &status, 0);
  return status;
}

// Ctrl-C in the middle: a clean end, and what was done is stored.
TEST(Program, AnInterruptStoresWhatWasDone) {
  const TemporaryFolder folder;
  write_archive(folder, 1400);
  const auto csv = folder.path() / "out.csv", database = folder.path() / "out.db";
  // The database is made once the first frames are on their way.
  const int status = interrupted_run(
      {"replay", folder.path().string(), "--csv", csv.string(), "--db", database.string()}, database);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  const auto lines = lines_of(read_all(csv));
  ASSERT_GE(lines.size(), 1U);
  EXPECT_EQ(lines[0], kObservationCsvHeader);
  EXPECT_LT(lines.size(), 1401U) << "it was not interrupted";
  for (const std::string& line : lines) EXPECT_EQ(std::count(line.begin(), line.end(), ','), 12) << line;
  storage::Reader reader(database);
  EXPECT_EQ(reader.check(true), "ok");
  const auto camera = reader.camera("small");
  ASSERT_TRUE(camera);
  storage::ObservationQuery query;
  query.camera = camera->number;
  query.to = TimePoint::max();
  query.limit = 2000;
  EXPECT_EQ(reader.observations(query).size() + 1, lines.size())
      << "the database and the CSV hold the same frames";
}

TEST(Program, AnInterruptedSimulationIsAWholeArchive) {
  const TemporaryFolder folder;
  const auto night = folder.path() / "night";
  const int status = interrupted_run({"simulate", night.string(), "--style", "webcam", "--frames", "500",
                                      "--photons", "1000", "--workers", "2"},
                                     night / "images/0003.jpg");
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  const std::size_t frames = lines_of(read_all(night / "frames.csv")).size() - 1;
  EXPECT_GE(frames, 4U);
  EXPECT_LT(frames, 502U) << "it was not interrupted";
  EXPECT_EQ(lines_of(read_all(night / "truth.csv")).size() - 1, frames - 2);
  using Files = std::filesystem::directory_iterator;
  EXPECT_EQ(static_cast<std::size_t>(std::distance(Files(night / "images"), Files())), frames);
  EXPECT_EQ(run_program({"check-config", (night / "site.toml").string()}).exit_code, 0);
}

TEST(Program, ASimulationThatIsStoppedBeforeItsFirstFrameLeavesNothing) {
  const TemporaryFolder folder;
  const auto night = folder.path() / "night";
  const int status = interrupted_run({"simulate", night.string(), "--frames", "40", "--photons", "300000"},
                                     night / "images");
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0) << status;
  EXPECT_TRUE(std::filesystem::is_empty(night));
}

}  // namespace
}  // namespace lampglow
