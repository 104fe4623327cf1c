#include "daemon/simulation/simulate.h"

#include <gtest/gtest.h>
#include <stdlib.h>
#include <sys/wait.h>

#include <cstdio>
#include <fstream>
#include <map>
#include <sstream>

namespace lampglow::simulation {
namespace {

namespace fs = std::filesystem;

class Simulate : public testing::Test {
 protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "lampglow-simulate-XXXXXX").string();
    ASSERT_NE(mkdtemp(name.data()), nullptr);
    directory_ = name;
  }
  void TearDown() override { fs::remove_all(directory_); }

  fs::path directory_;
};

std::map<std::string, std::string> all_files(const fs::path& directory) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(directory)) {
    if (!entry.is_regular_file()) continue;
    std::ostringstream text;
    text << std::ifstream(entry.path(), std::ios::binary).rdbuf();
    files[fs::relative(entry.path(), directory).string()] = text.str();
  }
  return files;
}

void simulate(const NightOptions& options, const fs::path& directory, int workers) {
  simulate_night(options, {.directory = directory, .photons = 20000, .workers = workers},
                 [](const std::string&, int, int) {});
}

TEST_F(Simulate, SameSeedSameBytesForAnyNumberOfWorkers) {
  for (const Style style : {Style::bracket, Style::webcam}) {
    const fs::path out = directory_ / (style == Style::bracket ? "bracket" : "webcam");
    const NightOptions options{.seed = 3, .frames = 2, .lamps = 2, .style = style};
    simulate(options, out / "one", 1);
    simulate(options, out / "two", 2);
    const auto one = all_files(out / "one");
    EXPECT_EQ(one.size(), style == Style::bracket ? 5 + 4 * 3 : 5 + 4);
    EXPECT_TRUE(one == all_files(out / "two"));
  }
}

TEST_F(Simulate, TablesSayWhatTheArchiveFormatAsks) {
  simulate({.seed = 3, .frames = 1, .lamps = 2}, directory_ / "night", 2);
  const auto files = all_files(directory_ / "night");
  const std::string frames = files.at("frames.csv");
  EXPECT_EQ(frames.substr(0, frames.find('\n')), "time_utc,file,exposure_s,gain_db,role,reference_mor_m");
  EXPECT_NE(frames.find("images/0000_0.png,0.008,0,clear_reference,"), std::string::npos) << frames;
  EXPECT_NE(frames.find("images/0002_2.png,2,0,observation,\n"), std::string::npos) << frames;
  const std::string truth = files.at("truth.csv");
  EXPECT_EQ(truth.substr(0, 22), "time_utc,mor_m,q,weath");
  EXPECT_NE(files.at("site.toml").find("[[light]]\nid = \"L2\""), std::string::npos);
}

struct CommandResult {
  int exit_code = -1;
  std::string output;
};

CommandResult run_lampglow(const std::string& arguments) {
  FILE* pipe = popen((std::string(LAMPGLOW_BINARY) + " " + arguments + " 2>&1").c_str(), "r");
  CommandResult result;
  char buffer[4096];
  while (const size_t size = fread(buffer, 1, sizeof buffer, pipe)) result.output.append(buffer, size);
  result.exit_code = WEXITSTATUS(pclose(pipe));
  return result;
}

TEST_F(Simulate, CommandPrintsItsSeed) {
  const std::string out = (directory_ / "out").string();
  const CommandResult made =
      run_lampglow("simulate " + out + " --seed 12 --frames 1 --lamps 1 --photons 2000");
  EXPECT_EQ(made.exit_code, 0) << made.output;
  EXPECT_NE(made.output.find("seed 12"), std::string::npos) << made.output;
  const CommandResult again = run_lampglow("simulate " + out);
  EXPECT_EQ(again.exit_code, 64);
  EXPECT_NE(again.output.find("is not empty; nothing was written"), std::string::npos) << again.output;
}

TEST_F(Simulate, BadUsageIsRefused) {
  const std::string out = " " + (directory_ / "out").string();
  for (const char* bad :
       {"--frames 0", "--style film", "--lamps 99", "--without rain", "--nearest 500 --farthest 100",
        "--mor-min 900 --mor-max 100", "--photons -1", "--catalogue L99"}) {
    const CommandResult result = run_lampglow("simulate " + std::string(bad) + out);
    EXPECT_EQ(result.exit_code, 64) << bad << "\n" << result.output;
  }
  EXPECT_FALSE(fs::exists(directory_ / "out"));
}

}  // namespace
}  // namespace lampglow::simulation
