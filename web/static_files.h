// The dashboard's files and the OpenAPI description, which are part of the program (web/static,
// web/openapi.json).
#pragma once

#include <optional>
#include <string_view>
#include <vector>

namespace lampglow::web {

struct StaticFile {
  std::string_view path;  // "/index.html"
  std::string_view content_type;
  std::string_view content;
};

std::optional<StaticFile> static_file(std::string_view path);
std::vector<StaticFile> static_files();

}  // namespace lampglow::web
