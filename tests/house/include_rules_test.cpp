// The walls of the house: which folder may include what (docs/code.md). Reads the sources themselves.
#include <gmock/gmock.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

namespace lampglow {
namespace {

namespace fs = std::filesystem;
using Prefixes = std::vector<std::string>;

// The first rule whose folder fits a file decides.
struct Rule {
  std::string folder;
  Prefixes ours;
  Prefixes third_party;  // in .cpp files, and in headers that no other folder includes
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
      // Asks the system for large pages (sys/mman.h), on which no result depends.
      {"estimator/photometry/pixel_memory.h",
       {},
       {},
       {"fstream", "filesystem", "thread", "mutex", "unistd.h", "fcntl.h"}},
      {"estimator/scattering/", {"estimator/scattering/"}, {"fftw3.h"}, kPure},
      {"estimator/photometry/", Prefixes{"estimator/photometry/"} + kTypes, {"opencv2/"}, kPure},
      {"estimator/inference/",
       Prefixes{"estimator/inference/", "estimator/photometry/", "estimator/scattering/"} + kTypes,
       {"ceres/", "Eigen/"},
       kPure},
      {"estimator/", {"estimator/"}, {}, kPure},
      {"storage/", Prefixes{"storage/"} + kTypes, {"sqlite3.h", "SQLiteCpp/"}, {}},
      {"web/", Prefixes{"web/", "storage/", "embedded_"} + kTypes, {"boost/", "openssl/", "fmt/"}, {}},
      {"daemon/",
       {"daemon/", "estimator/", "storage/", "web/"},
       {"boost/", "toml++/", "CLI/", "fmt/", "spdlog/", "opencv2/", "curl/", "libav", "libswscale/",
        "libcamera/", "jpeglib.h", "jerror.h", "png.h", "tiffio.h", "OpenEXR/", "systemd/", "openssl/",
        "linux/"},
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
  return starts_with_any(
      header, {"sys/", "netinet/", "arpa/", "netdb.h", "unistd.h", "fcntl.h", "poll.h", "pthread.h",
               "signal.h", "strings.h", "malloc.h", "dirent.h", "grp.h", "pwd.h", "termios.h"});
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
  return starts_with_any(header, rule->third_party) ? "" : rule->folder + " may not use this library";
}

bool is_third_party(const std::string& header) {
  return std::any_of(rules().begin(), rules().end(),
                     [&](const Rule& r) { return starts_with_any(header, r.third_party); });
}

struct Include {
  std::string file;  // from the root
  int line = 0;
  std::string header;
  bool quoted = false;
};

std::vector<Include> includes_of(const std::string& file, std::istream& text) {
  static const std::regex include(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::vector<Include> found;
  std::string line;
  for (int number = 1; std::getline(text, line); ++number) {
    std::smatch match;
    if (std::regex_search(line, match, include)) found.push_back({file, number, match[2], match[1] == "\""});
  }
  return found;
}

std::string folder_of(const std::string& file) {
  return fs::path(file).parent_path().string();
}

std::vector<std::string> objections(const std::vector<Include>& includes) {
  std::map<std::string, std::string> third_party_in_header;  // header of ours -> library's header
  for (const Include& i : includes)
    if (i.file.ends_with(".h") && !i.quoted && is_third_party(i.header))
      third_party_in_header[i.file] = i.header;
  std::vector<std::string> found;
  for (const Include& i : includes) {
    std::string why = objection(i.file, i.header, i.quoted);
    if (const auto leak = third_party_in_header.find(i.header);
        why.empty() && leak != third_party_in_header.end() && folder_of(i.file) != folder_of(i.header))
      why = "a header that includes " + leak->second + " stays within its folder";
    if (!why.empty()) found.push_back(i.file + ":" + std::to_string(i.line) + ": " + i.header + ": " + why);
  }
  return found;
}

using File = std::pair<std::string, std::string>;  // path and text

std::vector<std::string> objections_to(const std::vector<File>& files) {
  std::vector<Include> includes;
  for (const auto& [file, text] : files) {
    std::istringstream in(text);
    const auto more = includes_of(file, in);
    includes.insert(includes.end(), more.begin(), more.end());
  }
  return objections(includes);
}

TEST(IncludeRules, TheTreeKeepsThem) {
  const fs::path root = LAMPGLOW_SOURCE_DIR;
  int files = 0;
  std::vector<Include> includes;
  for (const char* folder : {"estimator", "storage", "web", "daemon"})
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".h" && extension != ".cpp") continue;
      ++files;
      std::ifstream text(entry.path());
      const auto more = includes_of(fs::relative(entry.path(), root).string(), text);
      includes.insert(includes.end(), more.begin(), more.end());
    }
  EXPECT_THAT(objections(includes), testing::IsEmpty());
  EXPECT_GT(files, 50) << "the sources were not found";
}

TEST(IncludeRules, AForbiddenIncludeIsFound) {
  const auto one = [](const std::string& file, const std::string& text) {
    const auto found = objections_to({{file, text}});
    return found.size() == 1 ? found[0] : std::to_string(found.size()) + " complaints";
  };
  EXPECT_EQ(one("estimator/scattering/a.cpp", "\n#include \"estimator/photometry/image.h\"\n"),
            "estimator/scattering/a.cpp:2: estimator/photometry/image.h: estimator/scattering/ may not "
            "include this of "
            "ours");
  EXPECT_EQ(one("estimator/photometry/a.cpp", "# include <ceres/ceres.h>"),
            "estimator/photometry/a.cpp:1: ceres/ceres.h: estimator/photometry/ may not use this library");
  EXPECT_EQ(one("estimator/estimate.cpp", "#include <fstream>"),
            "estimator/estimate.cpp:1: fstream: the science has no files, clock, threads, logging, sockets");
  EXPECT_EQ(
      one("estimator/inference/a.cpp", "#include <sys/stat.h>"),
      "estimator/inference/a.cpp:1: sys/stat.h: the science has no files, clock, threads, logging, sockets");
  EXPECT_EQ(one("web/a.cpp", "#include \"estimator/estimate.h\""),
            "web/a.cpp:1: estimator/estimate.h: web/ may not include this of ours");
  EXPECT_EQ(one("storage/a.cpp", "#include \"web/server.h\""),
            "storage/a.cpp:1: web/server.h: storage/ may not include this of ours");
}

TEST(IncludeRules, AThirdPartyTypeStaysWithinItsFolder) {
  const File header{"storage/sqlite.h", "#include <sqlite3.h>\n"};
  EXPECT_THAT(objections_to({header, {"storage/store.cpp", "#include \"storage/sqlite.h\"\n"}}),
              testing::IsEmpty());
  EXPECT_THAT(objections_to({header, {"web/a.cpp", "#include \"storage/sqlite.h\"\n"}}),
              testing::ElementsAre(
                  "web/a.cpp:1: storage/sqlite.h: a header that includes sqlite3.h stays within its folder"));
}

TEST(IncludeRules, WhatIsAllowedPasses) {
  EXPECT_THAT(objections_to({{"estimator/inference/a.cpp",
                              "#include <ceres/ceres.h>\n#include <vector>\n"
                              "#include \"estimator/scattering/medium.h\"\n"},
                             {"daemon/a.cpp", "#include <sys/stat.h>\n#include \"web/server.h\"\n"},
                             {"web/a.h", "#include <chrono>\n#include \"estimator/observation.h\"\n"}}),
              testing::IsEmpty());
}

}  // namespace
}  // namespace lampglow
