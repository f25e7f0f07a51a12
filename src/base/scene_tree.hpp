// The scene as a plain tree of located values: the rest of the library never includes toml++.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <variant>
#include <vector>

namespace mpm {

// Line and column count from 1; line 0 means that only the source is known (an override, an absent table).
struct Location {
  std::string source;  // a file name or "--set key.path"
  int line = 0;
  int column = 0;

  std::string text() const;
};
// File order, overrides last.
bool comes_before(const Location& a, const Location& b);

struct SceneNode;

struct SceneMember {
  std::string key;
  Location key_location;
  std::unique_ptr<SceneNode> value;
};
struct SceneTable {
  std::vector<SceneMember> members;  // in file order

  const SceneMember* find(std::string_view key) const;
  SceneMember* find(std::string_view key);
};
using SceneArray = std::vector<std::unique_ptr<SceneNode>>;
struct SceneOther {};  // dates and times, which no parameter takes

struct SceneNode {
  Location location;
  std::variant<SceneTable, SceneArray, std::string, double, std::int64_t, bool, SceneOther> value;

  const SceneTable* table() const { return std::get_if<SceneTable>(&value); }
  const SceneArray* array() const { return std::get_if<SceneArray>(&value); }
  const char* type_name() const;  // "a table", "a number", ...
  std::string text() const;       // the value as written in a message, shortened
};

// Throws UserError with file:line:column for syntax errors and duplicate keys.
std::unique_ptr<SceneNode> parse_scene(std::string_view text, const std::string& file_name);
// "key.path=value": replaces or adds one value. Throws UserError.
void apply_override(SceneNode& root, std::string_view assignment);

}  // namespace mpm
