#include "scene_tree.hpp"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"

namespace mpm {
namespace {

Location location_of(const toml::source_region& source, const std::string& file_name) {
  return {file_name, static_cast<int>(source.begin.line), static_cast<int>(source.begin.column)};
}

std::unique_ptr<SceneNode> convert(const toml::node& node, const std::string& file_name) {
  auto result = std::make_unique<SceneNode>();
  result->location = location_of(node.source(), file_name);
  if (const auto* table = node.as_table()) {
    SceneTable members;
    for (const auto& [key, value] : *table)
      members.members.push_back(
          {std::string(key.str()), location_of(key.source(), file_name), convert(value, file_name)});
    // toml++ sorts by name.
    std::stable_sort(members.members.begin(), members.members.end(), [](const auto& a, const auto& b) {
      return comes_before(a.key_location, b.key_location);
    });
    result->value = std::move(members);
  } else if (const auto* array = node.as_array()) {
    SceneArray elements;
    for (const auto& element : *array) elements.push_back(convert(element, file_name));
    result->value = std::move(elements);
  } else if (const auto* text = node.as_string()) {
    result->value = text->get();
  } else if (const auto* number = node.as_floating_point()) {
    result->value = number->get();
  } else if (const auto* integer = node.as_integer()) {
    result->value = integer->get();
  } else if (const auto* flag = node.as_boolean()) {
    result->value = flag->get();
  } else {
    result->value = SceneOther{};
  }
  return result;
}

void forget_lines(SceneNode& node, const std::string& source) {
  node.location = {source, 0, 0};
  if (auto* table = std::get_if<SceneTable>(&node.value))
    for (SceneMember& member : table->members) {
      member.key_location = node.location;
      forget_lines(*member.value, source);
    }
  if (auto* array = std::get_if<SceneArray>(&node.value))
    for (auto& element : *array) forget_lines(*element, source);
}

// A value as in TOML; what is no TOML (32 GPa, explicit) is a string, and .5 or 1. are numbers as in a shell.
std::unique_ptr<SceneNode> parse_override_value(std::string_view text, const std::string& source) {
  auto result = std::make_unique<SceneNode>();
  try {
    const toml::table parsed = toml::parse("value = " + std::string(text), source);
    result = convert(*parsed.get("value"), source);
  } catch (const toml::parse_error& error) {
    if (text.starts_with('[') || text.starts_with('{') || text.starts_with('"') || text.starts_with('\''))
      throw UserError(fmt::format("{}: the value can't be read: {}.", source, error.description()));
    const std::string word(text);
    char* end = nullptr;
    const double number = std::strtod(word.c_str(), &end);
    const bool is_number = !word.empty() && *end == '\0' && word.find_first_of("xXnN") == std::string::npos;
    if (is_number) {
      result->value = number;
    } else {
      result->value = word;
    }
  }
  forget_lines(*result, source);
  return result;
}

// Splits at dots; a quoted part keeps its dots: material."steel.1".density.
std::vector<std::string> key_path(std::string_view text) {
  std::vector<std::string> parts(1);
  char quote = 0;
  for (char c : text) {
    if (quote) {
      if (c == quote) {
        quote = 0;
      } else {
        parts.back() += c;
      }
    } else if (c == '"' || c == '\'') {
      quote = c;
    } else if (c == '.') {
      parts.emplace_back();
    } else {
      parts.back() += c;
    }
  }
  return parts;
}

std::size_t array_index(const SceneArray& array, const std::string& part, const std::string& source,
                        const std::string& parent) {
  const bool is_number =
      !part.empty() && part.size() < 9 && part.find_first_not_of("0123456789") == std::string::npos;
  const std::string range =
      array.empty() ? "it is empty" : fmt::format("it takes an index from 0 to {}", array.size() - 1);
  require(is_number, "{}: {} is a list, so '{}' can't follow it; {}.", source, parent, part, range);
  const std::size_t index = std::stoul(part);
  require(index < array.size(), "{}: {} has {} entries, so there is no number {}; {}.", source, parent,
          array.size(), index, range);
  return index;
}

}  // namespace

std::string Location::text() const {
  return line > 0 ? fmt::format("{}:{}:{}", source, line, column) : source;
}

bool comes_before(const Location& a, const Location& b) {
  if ((a.line == 0) != (b.line == 0)) return b.line == 0;
  return std::pair(a.line, a.column) < std::pair(b.line, b.column);
}

const SceneMember* SceneTable::find(std::string_view key) const {
  const auto found = std::find_if(members.begin(), members.end(),
                                  [&](const SceneMember& member) { return member.key == key; });
  return found == members.end() ? nullptr : &*found;
}

SceneMember* SceneTable::find(std::string_view key) {
  return const_cast<SceneMember*>(std::as_const(*this).find(key));
}

const char* SceneNode::type_name() const {
  constexpr const char* names[] = {"a table",    "a list",        "a text", "a number",
                                   "an integer", "true or false", "a date"};
  return names[value.index()];
}

std::string SceneNode::text() const {
  if (const auto* text = std::get_if<std::string>(&value))
    return text->size() > 60 ? fmt::format("\"{}...\"", text->substr(0, 57)) : fmt::format("\"{}\"", *text);
  if (const auto* number = std::get_if<double>(&value)) return fmt::format("{}", *number);
  if (const auto* integer = std::get_if<std::int64_t>(&value)) return fmt::format("{}", *integer);
  if (const auto* flag = std::get_if<bool>(&value)) return *flag ? "true" : "false";
  return type_name();
}

std::unique_ptr<SceneNode> parse_scene(std::string_view text, const std::string& file_name) {
  try {
    return convert(toml::parse(text, file_name), file_name);
  } catch (const toml::parse_error& error) {
    throw UserError(fmt::format("{}: {}; correct the TOML syntax there.",
                                location_of(error.source(), file_name).text(), error.description()));
  }
}

void apply_override(SceneNode& root, std::string_view assignment) {
  const auto equals = assignment.find('=');
  require(equals != std::string_view::npos && equals > 0,
          "--set {}: an override has the form key.path=value, such as time.end=1e-3.", assignment);
  const std::string path(trimmed(assignment.substr(0, equals)));
  const std::string source = "--set " + path;
  const std::vector<std::string> parts = key_path(path);
  auto value = parse_override_value(trimmed(assignment.substr(equals + 1)), source);

  SceneNode* node = &root;
  std::string walked;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const bool is_last = i + 1 == parts.size();
    require(!parts[i].empty(), "{}: the key path has an empty part; write it as key.path=value.", source);
    std::unique_ptr<SceneNode>* place = nullptr;
    if (auto* array = std::get_if<SceneArray>(&node->value)) {
      place = &(*array)[array_index(*array, parts[i], source, walked)];
    } else if (auto* table = std::get_if<SceneTable>(&node->value)) {
      if (SceneMember* member = table->find(parts[i])) {
        place = &member->value;
        if (is_last) member->key_location = {source, 0, 0};
      } else {
        auto added = std::make_unique<SceneNode>();
        added->location = {source, 0, 0};
        table->members.push_back({parts[i], added->location, std::move(added)});
        place = &table->members.back().value;
      }
    } else {
      throw UserError(
          fmt::format("{}: {} is {}, so '{}' can't follow it.", source, walked, node->type_name(), parts[i]));
    }
    if (is_last) {
      *place = std::move(value);
    } else {
      node = place->get();
      walked += (walked.empty() ? "" : ".") + parts[i];
    }
  }
}

}  // namespace mpm
