// A TOML file read strictly: every key is asked for by name, what nobody asked for is refused with the
// nearest known key, and all that is wrong is told at once, with line and column.
//
//   ConfigFile file = ConfigFile::read("site.toml");
//   ConfigTable camera = file.root().required_table("camera");
//   site.camera.width_px = camera.required_integer("width_px", 1, 65535);
//   file.finish();   // throws ConfigError with every problem; values got before are good only after it
#pragma once

#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace lampglow::daemon {

// Bounds of a number, both allowed values.
struct NumberRange {
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};

// Above zero: the smallest normal number and up.
inline constexpr NumberRange kPositive{std::numeric_limits<double>::min(),
                                       std::numeric_limits<double>::infinity()};
inline constexpr NumberRange kNotNegative{0.0, std::numeric_limits<double>::infinity()};

// One table of the file. Cheap to copy; the ConfigFile may be gone before it.
// Each of text(), number(), ... is empty if the key is absent, and also, with a problem noted, if its value
// is no such thing. The required_ forms note a problem for an absent key, too, and then return 0 or empty
// text.
class ConfigTable {
 public:
  std::optional<std::string> text(std::string_view key);
  std::optional<std::string> one_of(std::string_view key, const std::vector<std::string_view>& choices);
  std::optional<double> number(std::string_view key, NumberRange range = {});
  std::optional<std::int64_t> integer(std::string_view key, std::int64_t low, std::int64_t high);
  std::optional<bool> boolean(std::string_view key);
  // A list of exactly `count` numbers; of any length for count 0.
  std::optional<std::vector<double>> numbers(std::string_view key, std::size_t count, NumberRange range = {});
  std::optional<std::vector<std::string>> texts(std::string_view key);
  std::optional<ConfigTable> table(std::string_view key);
  std::vector<ConfigTable> tables(std::string_view key);  // [[key]], none if absent

  std::string required_text(std::string_view key);
  double required_number(std::string_view key, NumberRange range = {});
  std::int64_t required_integer(std::string_view key, std::int64_t low, std::int64_t high);
  ConfigTable required_table(std::string_view key);

  // Is the key there? Counts as asking for it.
  bool has(std::string_view key);
  // Notes a problem at the key (at the table, if the key is absent).
  void problem(std::string_view key, const std::string& message);

 private:
  friend class ConfigFile;
  struct State;
  struct Document;
  ConfigTable(std::shared_ptr<Document> document, State* state)
      : document_(std::move(document)), state_(state) {}
  std::shared_ptr<Document> document_;
  State* state_;
};

class ConfigFile {
 public:
  // Throws ConfigError where the text is no TOML. `name` is for messages.
  ConfigFile(std::string_view text, const std::string& name);
  // Throws IoError where the file cannot be read.
  static ConfigFile read(const std::filesystem::path& path);

  ConfigTable root();

  // Throws ConfigError if there was any problem or any key that nobody asked for.
  void finish();

 private:
  std::shared_ptr<ConfigTable::Document> document_;
};

// The one of `known` that is closest to `text` by edits; empty if none is close.
std::optional<std::string> nearest_key(std::string_view text, const std::vector<std::string>& known);

// A number as TOML or CSV: the shortest text that reads back as the same value, with a point or exponent.
std::string format_number(double value);
// A quoted and escaped TOML string.
std::string format_text(std::string_view text);

}  // namespace lampglow::daemon
