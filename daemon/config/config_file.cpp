#include "daemon/config/config_file.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <sstream>

#include "daemon/config/files.h"
#include "daemon/config/problems.h"
#include "daemon/errors.h"

namespace lampglow::daemon {

struct ConfigTable::State {
  const toml::table* table;  // null for a required table that is absent
  std::string path;          // "camera.", "light[2]."; empty for the root
  std::vector<std::string> asked;

  const toml::node* ask(std::string_view key) {
    if (std::find(asked.begin(), asked.end(), key) == asked.end()) asked.emplace_back(key);
    return table ? table->get(key) : nullptr;
  }
};

struct ConfigTable::Document {
  Document(toml::table parsed, const std::string& name) : root(std::move(parsed)), problems(name) {
    states.push_back({&root, "", {}});
  }

  toml::table root;
  std::deque<State> states;  // a deque: pointers to its elements stay good
  Problems problems;

  void add(const toml::node& node, const std::string& field, const std::string& message) {
    problems.add(node.source().begin.line, node.source().begin.column, field, message);
  }

  State* open(const toml::table& table, const std::string& path) {
    for (State& state : states)
      if (state.table == &table) return &state;
    return &states.emplace_back(State{&table, path, {}});
  }
};

namespace {

std::string describe(const toml::node& node) {
  if (node.is_table()) return "a table";
  if (node.is_array()) return "a list";
  if (const auto* real = node.as_floating_point()) return format_number(real->get());
  if (const auto* text = node.as_string()) return format_text(text->get());
  std::ostringstream out;
  node.visit([&out](const auto& concrete) { out << concrete; });
  return out.str();
}

std::string describe(NumberRange range) {
  const bool low = std::isfinite(range.low), high = std::isfinite(range.high);
  if (low && high) return fmt::format("a number from {} to {}", range.low, range.high);
  if (low && range.low == kPositive.low) return "a number above 0";
  if (low) return fmt::format("a number of at least {}", range.low);
  if (high) return fmt::format("a number of at most {}", range.high);
  return "a finite number";
}

std::optional<double> number_in(const toml::node& node, NumberRange range) {
  std::optional<double> value;
  if (const auto* whole = node.as_integer()) value = static_cast<double>(whole->get());
  if (const auto* real = node.as_floating_point()) value = real->get();
  if (!value || !std::isfinite(*value) || *value < range.low || *value > range.high) return std::nullopt;
  return value;
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] == b[j - 1] ? 0 : 1)});
      diagonal = above;
    }
  }
  return row.back();
}

std::string join(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

std::string unknown_key_message(const std::string& key, const std::vector<std::string>& known) {
  if (const auto near = nearest_key(key, known)) return "unknown key; did you mean " + *near + "?";
  return "unknown key; expected one of " + join(known);
}

}  // namespace

std::optional<std::string> ConfigTable::text(std::string_view key) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  if (const auto* value = node->as_string()) return value->get();
  problem(key, "expected a text in quotes, got " + describe(*node));
  return std::nullopt;
}

std::optional<std::string> ConfigTable::one_of(std::string_view key,
                                               const std::vector<std::string_view>& choices) {
  auto value = text(key);
  if (!value || std::find(choices.begin(), choices.end(), *value) != choices.end()) return value;
  std::string list;
  for (const std::string_view choice : choices) list += (list.empty() ? "" : ", ") + format_text(choice);
  problem(key, "expected one of " + list + ", got " + format_text(*value));
  return std::nullopt;
}

std::optional<double> ConfigTable::number(std::string_view key, NumberRange range) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  const auto value = number_in(*node, range);
  if (!value) problem(key, "expected " + describe(range) + ", got " + describe(*node));
  return value;
}

std::optional<std::int64_t> ConfigTable::integer(std::string_view key, std::int64_t low, std::int64_t high) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  const auto* value = node->as_integer();
  if (value && value->get() >= low && value->get() <= high) return value->get();
  problem(key, fmt::format("expected a whole number from {} to {}, got {}", low, high, describe(*node)));
  return std::nullopt;
}

std::optional<bool> ConfigTable::boolean(std::string_view key) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  if (const auto* value = node->as_boolean()) return value->get();
  problem(key, "expected true or false, got " + describe(*node));
  return std::nullopt;
}

std::optional<std::vector<double>> ConfigTable::numbers(std::string_view key, std::size_t count,
                                                        NumberRange range) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  std::vector<double> values;
  const toml::array* list = node->as_array();
  bool good = list && (count == 0 || list->size() == count);
  for (std::size_t i = 0; good && i < list->size(); ++i) {
    const auto value = number_in(*list->get(i), range);
    good = value.has_value();
    if (value) values.push_back(*value);
  }
  if (good) return values;
  const std::string length = count == 0 ? "" : fmt::format("of {} ", count);
  problem(key, "expected a list " + length + "with in each place " + describe(range) + ", got " +
                   (list ? fmt::format("a list of {} that is not so", list->size()) : describe(*node)));
  return std::nullopt;
}

std::optional<std::vector<std::string>> ConfigTable::texts(std::string_view key) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  std::vector<std::string> values;
  const toml::array* list = node->as_array();
  bool good = list != nullptr;
  for (std::size_t i = 0; good && i < list->size(); ++i) {
    const auto* value = list->get(i)->as_string();
    good = value != nullptr;
    if (value) values.push_back(value->get());
  }
  if (good) return values;
  problem(key, "expected a list of texts in quotes, got " + describe(*node));
  return std::nullopt;
}

std::optional<ConfigTable> ConfigTable::table(std::string_view key) {
  const toml::node* node = state_->ask(key);
  if (!node) return std::nullopt;
  if (const toml::table* inner = node->as_table())
    return ConfigTable(document_, document_->open(*inner, state_->path + std::string(key) + "."));
  problem(key, fmt::format("expected a table [{}], got {}", key, describe(*node)));
  return std::nullopt;
}

std::vector<ConfigTable> ConfigTable::tables(std::string_view key) {
  const toml::node* node = state_->ask(key);
  if (!node) return {};
  std::vector<ConfigTable> found;
  const toml::array* list = node->as_array();
  for (std::size_t i = 0; list && i < list->size(); ++i) {
    const toml::table* inner = list->get(i)->as_table();
    if (!inner) break;
    found.push_back(
        ConfigTable(document_, document_->open(*inner, fmt::format("{}{}[{}].", state_->path, key, i + 1))));
  }
  if (list && found.size() == list->size()) return found;
  problem(key, fmt::format("expected tables [[{}]], got {}", key, describe(*node)));
  return {};
}

std::string ConfigTable::required_text(std::string_view key) {
  if (!has(key)) problem(key, "is missing; expected a text in quotes");
  return text(key).value_or("");
}

double ConfigTable::required_number(std::string_view key, NumberRange range) {
  if (!has(key)) problem(key, "is missing; expected " + describe(range));
  return number(key, range).value_or(0);
}

std::int64_t ConfigTable::required_integer(std::string_view key, std::int64_t low, std::int64_t high) {
  if (!has(key)) problem(key, fmt::format("is missing; expected a whole number from {} to {}", low, high));
  return integer(key, low, high).value_or(0);
}

ConfigTable ConfigTable::required_table(std::string_view key) {
  if (!has(key) && state_->table) problem(key, fmt::format("is missing; expected a table [{}]", key));
  if (auto inner = table(key)) return *inner;
  return ConfigTable(document_, &document_->states.emplace_back(State{nullptr, "", {}}));
}

bool ConfigTable::has(std::string_view key) {
  return state_->ask(key) != nullptr;
}

void ConfigTable::problem(std::string_view key, const std::string& message) {
  if (!state_->table) return;  // the table's absence is noted already
  const toml::node* node = state_->table->get(key);
  document_->add(node ? *node : *state_->table, state_->path + std::string(key), message);
}

ConfigFile::ConfigFile(std::string_view text, const std::string& name) {
  try {
    document_ = std::make_shared<ConfigTable::Document>(toml::parse(text, name), name);
  } catch (const toml::parse_error& error) {
    const auto at = error.source().begin;
    throw ConfigError(fmt::format("{}:{}:{}: {}", name, at.line, at.column, error.description()));
  }
}

ConfigFile ConfigFile::read(const std::filesystem::path& path) {
  return {read_text_file(path), path.string()};
}

ConfigTable ConfigFile::root() {
  return {document_, &document_->states.front()};
}

void ConfigFile::finish() {
  for (const ConfigTable::State& state : document_->states) {
    if (!state.table) continue;
    for (const auto& [key, node] : *state.table) {
      const std::string name(key.str());
      if (std::find(state.asked.begin(), state.asked.end(), name) != state.asked.end()) continue;
      const auto at = key.source().begin;
      document_->problems.add(at.line, at.column, state.path + name, unknown_key_message(name, state.asked));
    }
  }
  document_->problems.throw_config_error();
}

std::optional<std::string> nearest_key(std::string_view text, const std::vector<std::string>& known) {
  std::optional<std::string> best;
  std::size_t best_distance = std::max<std::size_t>(2, text.size() / 3) + 1;
  for (const std::string& key : known) {
    const std::size_t distance = edit_distance(text, key);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = key;
  }
  return best;
}

std::string format_number(double value) {
  std::string text = fmt::format("{}", value);
  if (text.find_first_of(".en") == std::string::npos) text += ".0";
  return text;
}

std::string format_text(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F)
      quoted += fmt::format("\\u{:04X}", static_cast<unsigned>(c));
    else
      quoted += c;
  }
  return quoted + '"';
}

}  // namespace lampglow::daemon
