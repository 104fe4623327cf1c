// The walls of the house: which folder may include what (docs/code.md). Reads the sources themselves.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace lampglow {
namespace {

namespace fs = std::filesystem;
using Prefixes = std::vector<std::string>;

// The first rule whose folder fits a file decides.
struct Rule {
  std::string folder;
  Prefixes ours;
  Prefixes third_party;  // in .cpp files only
  Prefixes forbidden;    // of the standard library and the system
};

// The science has no files, clock, threads, logging, sockets.
const Prefixes kPure{"fstream",   "filesystem",         "iostream",   "thread",   "mutex",   "shared_mutex",
                     "future",    "condition_variable", "stop_token", "unistd.h", "fcntl.h", "poll.h",
                     "pthread.h", "signal.h",           "sys/",       "netinet/"};

const Prefixes kTypes{"estimator/observation", "estimator/quality.h", "estimator/time.h", "estimator/site.h"};

Prefixes operator+(Prefixes a, const Prefixes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

const std::vector<Rule>& rules() {
  static const std::vector<Rule> all{
      {"estimator/scattering/", {"estimator/scattering/"}, {"fftw3.h"}, kPure},
      {"estimator/photometry/", Prefixes{"estimator/photometry/"} + kTypes, {"opencv2/"}, kPure},
      {"estimator/inference/",
       Prefixes{"estimator/inference/", "estimator/photometry/", "estimator/scattering/"} + kTypes,
       {"ceres/", "Eigen/"},
       kPure},
      {"estimator/", {"estimator/"}, {}, kPure},
      {"storage/", Prefixes{"storage/"} + kTypes, {"sqlite3.h", "SQLiteCpp/"}, {}},
      {"web/", Prefixes{"web/", "storage/"} + kTypes, {"boost/", "openssl/", "fmt/"}, {}},
      {"daemon/",
       {"daemon/", "estimator/", "storage/", "web/"},
       {"boost/", "toml++/", "CLI/", "fmt/", "spdlog/", "opencv2/", "curl/", "libav", "libswscale/",
        "libcamera/", "jpeglib.h", "jerror.h", "systemd/", "openssl/", "linux/"},
       {}},
  };
  return all;
}

bool starts_with_any(const std::string& text, const Prefixes& prefixes) {
  return std::any_of(prefixes.begin(), prefixes.end(),
                     [&](const std::string& p) { return text.starts_with(p); });
}

// A header of the C++ or C library or of the system: no folder and no .h, or one of these.
bool is_system(const std::string& header) {
  if (header.find('/') == std::string::npos && header.find('.') == std::string::npos) return true;
  return starts_with_any(header, {"sys/", "netinet/", "arpa/", "netdb.h", "unistd.h", "fcntl.h", "poll.h",
                                  "pthread.h", "signal.h", "dirent.h", "grp.h", "pwd.h", "termios.h"});
}

// Why `file` (a path from the root) may not include `header`; empty if it may.
std::string objection(const std::string& file, const std::string& header, bool quoted) {
  const auto rule =
      std::find_if(rules().begin(), rules().end(), [&](const Rule& r) { return file.starts_with(r.folder); });
  if (rule == rules().end()) return "no rule for this folder";
  if (quoted)
    return starts_with_any(header, rule->ours) ? "" : rule->folder + " may not include this of ours";
  if (is_system(header))
    return std::find_if(rule->forbidden.begin(), rule->forbidden.end(),
                        [&](const std::string& f) {
                          return f.ends_with('/') ? header.starts_with(f) : header == f;
                        }) == rule->forbidden.end()
               ? ""
               : "the science has no files, clock, threads, logging, sockets";
  if (!starts_with_any(header, rule->third_party)) return rule->folder + " may not use this library";
  return file.ends_with(".cpp") ? "" : "third-party headers stand in .cpp files only";
}

std::vector<std::string> objections(const std::string& file, std::istream& text) {
  static const std::regex include(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::vector<std::string> found;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    std::smatch match;
    if (!std::regex_search(line, match, include)) continue;
    const std::string why = objection(file, match[2], match[1] == "\"");
    if (!why.empty())
      found.push_back(file + ":" + std::to_string(number) + ": " + match[2].str() + ": " + why);
  }
  return found;
}

std::vector<std::string> objections_to(const std::string& file, const std::string& text) {
  std::istringstream in(text);
  return objections(file, in);
}

TEST(IncludeRules, TheTreeKeepsThem) {
  const fs::path root = LAMPGLOW_SOURCE_DIR;
  int files = 0;
  for (const char* folder : {"estimator", "storage", "web", "daemon"})
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cpp") continue;
      ++files;
      std::ifstream text(entry.path());
      for (const std::string& complaint : objections(fs::relative(entry.path(), root).string(), text))
        ADD_FAILURE() << complaint;
    }
  EXPECT_GT(files, 50) << "the sources were not found";
}

TEST(IncludeRules, AForbiddenIncludeIsFound) {
  const auto one = [](const std::string& file, const std::string& text) {
    const auto found = objections_to(file, text);
    return found.size() == 1 ? found[0] : std::to_string(found.size()) + " complaints";
  };
  EXPECT_EQ(one("estimator/scattering/a.cpp", "\n#include \"estimator/photometry/image.h\"\n"),
            "estimator/scattering/a.cpp:2: estimator/photometry/image.h: estimator/scattering/ may not "
            "include this of "
            "ours");
  EXPECT_EQ(one("estimator/photometry/a.cpp", "# include <ceres/ceres.h>"),
            "estimator/photometry/a.cpp:1: ceres/ceres.h: estimator/photometry/ may not use this library");
  EXPECT_EQ(one("estimator/inference/a.h", "#include <ceres/ceres.h>"),
            "estimator/inference/a.h:1: ceres/ceres.h: third-party headers stand in .cpp files only");
  EXPECT_EQ(one("estimator/estimate.cpp", "#include <fstream>"),
            "estimator/estimate.cpp:1: fstream: the science has no files, clock, threads, logging, sockets");
  EXPECT_EQ(
      one("estimator/inference/a.cpp", "#include <sys/stat.h>"),
      "estimator/inference/a.cpp:1: sys/stat.h: the science has no files, clock, threads, logging, sockets");
  EXPECT_EQ(one("web/a.cpp", "#include \"estimator/estimate.h\""),
            "web/a.cpp:1: estimator/estimate.h: web/ may not include this of ours");
  EXPECT_EQ(one("storage/a.cpp", "#include \"web/server.h\""),
            "storage/a.cpp:1: web/server.h: storage/ may not include this of ours");
  EXPECT_EQ(one("daemon/a.h", "#include <CLI/CLI.hpp>"),
            "daemon/a.h:1: CLI/CLI.hpp: third-party headers stand in .cpp files only");
}

TEST(IncludeRules, WhatIsAllowedPasses) {
  EXPECT_TRUE(objections_to(
                  "estimator/inference/a.cpp",
                  "#include <ceres/ceres.h>\n#include <vector>\n#include \"estimator/scattering/medium.h\"\n")
                  .empty());
  EXPECT_TRUE(objections_to("daemon/a.cpp", "#include <sys/stat.h>\n#include \"web/server.h\"\n").empty());
  EXPECT_TRUE(objections_to("web/a.h", "#include <chrono>\n#include \"estimator/observation.h\"\n").empty());
}

}  // namespace
}  // namespace lampglow
