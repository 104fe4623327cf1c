// The site file (site.toml of an archive, and the same tables in the daemon's configuration) to a Site and
// back.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "daemon/config/config_file.h"
#include "estimator/site.h"

namespace lampglow::daemon {

// Throws ConfigError (exit 78) with every problem, `file:line:column: field: what was expected`;
// IoError if the file cannot be read.
Site read_site_file(const std::filesystem::path& path);

// The same from a text. Measured curves are looked for in `folder`; a curve's path may not leave it.
Site parse_site(std::string_view text, const std::string& name, const std::filesystem::path& folder);

// The tables [site], [camera], [[light]], [[target]] and [day] of a larger configuration.
Site read_site_tables(ConfigTable& tables, const std::filesystem::path& folder);

// A measured response curve: CSV with the columns dn and relative_radiance, one row for each DN from 0 to
// 2^bit_depth - 1 in order, values of at least 0 that never fall. Throws DataError, IoError.
std::vector<double> read_response_curve(const std::filesystem::path& path, int bit_depth);
std::string format_response_curve(const std::vector<double>& curve);

// One `[[light]]` or `[[target]]` block, ready to be pasted.
std::string format_light(const Light& light);
std::string format_target(const Target& target);

// The whole file. `response_file` is the value of camera.response for a measured curve.
std::string format_site(const Site& site, const std::string& response_file = "response.csv");

// Writes the site file and, for a measured curve, `STEM_response.csv` beside it; each is complete or as
// before.
void write_site_file(const std::filesystem::path& path, const Site& site);

}  // namespace lampglow::daemon
