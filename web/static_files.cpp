#include "web/static_files.h"

#include "embedded_declarations.inc"

namespace lampglow::web {
namespace {

StaticFile embedded(std::string_view path, std::string_view type, const char* begin, const char* end) {
  return {path, type, std::string_view(begin, static_cast<size_t>(end - begin))};
}

}  // namespace

std::vector<StaticFile> static_files() {
#define EMBEDDED(path, type, begin, end) embedded(path, type, begin, end),
  return {
#include "embedded_files.inc"
  };
#undef EMBEDDED
}

std::optional<StaticFile> static_file(std::string_view path) {
  static const std::vector<StaticFile> files = static_files();
  for (const StaticFile& file : files)
    if (file.path == path) return file;
  return std::nullopt;
}

}  // namespace lampglow::web
