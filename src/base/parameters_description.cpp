#include <cmath>

#include "mpm_hpc/base/parameters.hpp"
#include "parameters_impl.hpp"

namespace mpm {
namespace {

bool is_table(const DescribedKey& row) {
  return row.kind == ParameterKind::section || row.kind == ParameterKind::section_list ||
         row.kind == ParameterKind::named_sections;
}

// ---- the manual

std::string type_text(const DescribedKey& row) {
  const std::string unit = row.range.unit.empty() ? "" : fmt::format(" [{}]", row.range.unit);
  const std::string count = row.components > 0 ? fmt::format("{} numbers", row.components) : "numbers";
  switch (row.kind) {
    case ParameterKind::real:
      return "number" + unit;
    case ParameterKind::integer:
      return "integer";
    case ParameterKind::boolean:
      return "true or false";
    case ParameterKind::text:
      return "text";
    case ParameterKind::choice:
      return fmt::format("one of \"{}\"", fmt::join(row.choices, "\", \""));
    case ParameterKind::vector:
      return fmt::format("list of {}{}", count, unit);
    case ParameterKind::points:
      return fmt::format("list of points of {}{}", count, unit);
    case ParameterKind::text_list:
      return "list of texts";
    case ParameterKind::integer_list:
      return "list of integers";
    case ParameterKind::formulas:
      return row.rows > 0 ? fmt::format("{} rows of {} numbers or formulas{}", row.rows, row.components / row.rows, unit)
                          : fmt::format("list of {} or formulas{}", count, unit);
    case ParameterKind::definitions:
      return "table of formulas with names";
    case ParameterKind::section:
      return "table";
    case ParameterKind::section_list:
      return "list of tables";
    case ParameterKind::named_sections:
      return "tables with names";
  }
  return {};
}

std::string conditions_text(const DescribedKey& row) {
  std::string result;
  for (const Condition& condition : row.conditions)
    result += fmt::format(", with {} = \"{}\"", condition.key, fmt::join(condition.values, "\" or \""));
  return result;
}

std::string heading(const DescribedKey& row, const std::string& path) {
  if (row.kind == ParameterKind::section_list) return "[[" + path + "]]";
  if (row.kind == ParameterKind::named_sections) return "[" + path + ".NAME]";
  return "[" + path + "]";
}

// Values first, then tables, as a TOML file has to be written.
void print_table(const DescribedTable& table, const std::string& path, std::string& out) {
  for (const DescribedKey& row : table.keys) {
    if (is_table(row) && row.children) continue;
    std::string line = fmt::format("  {:<28} {}", row.key, type_text(row));
    if (!row.definition.empty()) line += fmt::format(" of the form {}", row.definition);
    if (const std::string range = range_text(row.range); !range.empty()) line += ", " + range;
    if (row.range.required) line += ", required";
    if (!row.default_as.empty()) line += ", default " + row.default_as;
    out += line + conditions_text(row) + "\n";
    if (!row.range.doc.empty()) out += fmt::format("  {:<28}   {}\n", "", row.range.doc);
  }
  for (const DescribedKey& row : table.keys) {
    if (!row.children) continue;
    const std::string inner = path.empty() ? row.key : path + "." + row.key;
    out += fmt::format("\n{}{}{}{}\n", heading(row, inner), row.range.required ? "  required" : "",
                       conditions_text(row), row.range.doc.empty() ? "" : "  " + row.range.doc);
    print_table(*row.children, row.kind == ParameterKind::named_sections ? inner + ".NAME" : inner, out);
  }
}

// ---- the JSON schema, draft 2020-12

class JsonObject {
 public:
  // An empty value is left out.
  JsonObject& add(std::string_view key, const std::string& value) {
    if (!value.empty()) members_.push_back(json_text(key) + ": " + value);
    return *this;
  }
  JsonObject& add_text(std::string_view key, std::string_view value) {
    return value.empty() ? *this : add(key, json_text(value));
  }
  std::string text() const { return fmt::format("{{{}}}", fmt::join(members_, ", ")); }
  bool empty() const { return members_.empty(); }

 private:
  std::vector<std::string> members_;
};

std::string json_list(const std::vector<std::string>& items) {
  return fmt::format("[{}]", fmt::join(items, ", "));
}

std::string json_texts(const std::vector<std::string>& texts) {
  std::vector<std::string> quoted;
  for (const std::string& text : texts) quoted.push_back(json_text(text));
  return json_list(quoted);
}

std::string number_schema(const RealOptions& range, bool is_integer) {
  JsonObject number;
  number.add_text("type", is_integer ? "integer" : "number");
  number.add(range.min_exclusive ? "exclusiveMinimum" : "minimum", json_number(range.min));
  number.add(range.max_exclusive ? "exclusiveMaximum" : "maximum", json_number(range.max));
  if (is_integer) return number.text();
  JsonObject text;
  text.add_text("type", "string");
  text.add_text("pattern",
                R"(^\s*[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?)" +
                    std::string(range.unit.empty() ? R"(\s*%?\s*$)" : R"(\s*[^-+0-9.\s].*$|^.*\s1/.*$)"));
  return JsonObject().add("anyOf", json_list({number.text(), text.text()})).text();
}

std::string list_schema(const std::string& items, int size) {
  JsonObject list;
  list.add_text("type", "array").add("items", items);
  if (size > 0) list.add("minItems", fmt::format("{}", size)).add("maxItems", fmt::format("{}", size));
  return list.text();
}

std::string table_schema(const DescribedTable& table);

std::string value_schema(const DescribedKey& row) {
  const std::string text_schema = R"({"type": "string"})";
  switch (row.kind) {
    case ParameterKind::real:
      return number_schema(row.range, false);
    case ParameterKind::integer:
      return number_schema(row.range, true);
    case ParameterKind::boolean:
      return R"({"type": "boolean"})";
    case ParameterKind::text:
      return text_schema;
    case ParameterKind::choice:
      return JsonObject().add("enum", json_texts(row.choices)).text();
    case ParameterKind::vector:
      return list_schema(number_schema(row.range, false), row.components);
    case ParameterKind::points:
      return list_schema(list_schema(number_schema(row.range, false), row.components), 0);
    case ParameterKind::text_list:
      return list_schema(text_schema, 0);
    case ParameterKind::integer_list:
      return list_schema(number_schema(row.range, true), 0);
    case ParameterKind::formulas: {
      const std::string component = R"({"type": ["number", "string"]})";
      return row.rows > 0 ? list_schema(list_schema(component, row.components / row.rows), row.rows)
                          : list_schema(component, row.components);
    }
    case ParameterKind::definitions:
      return R"({"type": "object", "additionalProperties": {"type": ["number", "string"]}})";
    default:
      break;
  }
  const std::string inner = row.children ? table_schema(*row.children)
                                         : JsonObject().add_text("$ref", "#/$defs/" + row.definition).text();
  if (row.kind == ParameterKind::section_list) return list_schema(inner, 0);
  if (row.kind == ParameterKind::named_sections)
    return JsonObject().add_text("type", "object").add("additionalProperties", inner).text();
  return inner;
}

std::string property_schema(const DescribedKey& row) {
  JsonObject notes;
  notes.add_text("description", row.range.doc)
      .add_text("x-unit", row.range.unit)
      .add("default", row.default_as);
  std::string schema = value_schema(row);
  if (notes.empty()) return schema;
  schema.back() = ',';  // both are objects with members: join them
  return schema + " " + notes.text().substr(1);
}

// {"if": the conditions hold, "then": the key is required}.
std::string conditional_requirement(const DescribedTable& table, const DescribedKey& row) {
  JsonObject properties;
  std::vector<std::string> must_be_given;
  for (const Condition& condition : row.conditions) {
    properties.add(condition.key, JsonObject().add("enum", json_texts(condition.values)).text());
    bool holds_by_default = false;
    for (const DescribedKey& other : table.keys)
      for (const std::string& value : condition.values)
        holds_by_default =
            holds_by_default || (other.key == condition.key && other.default_as == json_text(value));
    if (!holds_by_default) must_be_given.push_back(condition.key);
  }
  JsonObject antecedent;
  antecedent.add("properties", properties.text());
  if (!must_be_given.empty()) antecedent.add("required", json_texts(must_be_given));
  return JsonObject()
      .add("if", antecedent.text())
      .add("then", JsonObject().add("required", json_texts({row.key})).text())
      .text();
}

std::string table_schema(const DescribedTable& table) {
  JsonObject properties;
  std::vector<std::string> required, conditional, names;
  for (const DescribedKey& row : table.keys) {
    if (row.range.required && row.conditions.empty()) required.push_back(row.key);
    if (row.range.required && !row.conditions.empty())
      conditional.push_back(conditional_requirement(table, row));
    if (std::find(names.begin(), names.end(), row.key) != names.end()) continue;
    names.push_back(row.key);
    // Variants of a table may give one key different meanings.
    std::vector<std::string> variants;
    for (const DescribedKey& other : table.keys)
      if (other.key == row.key) variants.push_back(property_schema(other));
    properties.add(
        row.key, variants.size() == 1 ? variants[0] : JsonObject().add("anyOf", json_list(variants)).text());
  }
  JsonObject schema;
  schema.add_text("type", "object");
  schema.add("properties", properties.text());
  if (!required.empty()) schema.add("required", json_texts(required));
  if (!conditional.empty()) schema.add("allOf", json_list(conditional));
  schema.add("additionalProperties", "false");
  return schema.text();
}

// Breaks lines inside of objects and lists that hold objects.
std::string indented(const std::string& json) {
  std::string out;
  int depth = 0;
  bool in_text = false;
  std::vector<bool> is_broken;  // whether the brackets around are spread over lines
  const auto new_line = [&] { out += "\n" + std::string(static_cast<std::size_t>(2 * depth), ' '); };
  for (std::size_t i = 0; i < json.size(); ++i) {
    const char c = json[i];
    if (in_text) {
      out += c;
      if (c == '\\') out += json[++i];
      if (c == '"') in_text = false;
    } else if (c == '"') {
      out += c;
      in_text = true;
    } else if (c == '{' || c == '[') {
      const bool spread = (c == '{' && json[i + 1] != '}') || (c == '[' && json[i + 1] == '{');
      out += c;
      is_broken.push_back(spread);
      ++depth;
      if (spread) new_line();
    } else if (c == '}' || c == ']') {
      --depth;
      if (is_broken.back()) new_line();
      is_broken.pop_back();
      out += c;
    } else if (c == ',' && is_broken.back()) {
      out += c;
      ++i;  // the space after it
      new_line();
    } else {
      out += c;
    }
  }
  return out + "\n";
}

}  // namespace

std::string json_text(std::string_view text) {
  std::string result = "\"";
  for (char c : text) {
    if (c == '"' || c == '\\') {
      result += fmt::format("\\{}", c);
    } else if (static_cast<unsigned char>(c) < 0x20) {
      result += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    } else {
      result += c;
    }
  }
  return result + "\"";
}

std::string json_number(double value) {
  return std::isfinite(value) ? fmt::format("{}", value) : std::string();
}

std::string Parameters::describe_text() const {
  debug_check(describing(), "only a description can be printed");
  std::string out;
  print_table(impl_->description->root, "", out);
  for (const auto& [name, table] : impl_->description->definitions) {
    out += fmt::format("\n{} = {{...}}\n", name);
    print_table(*table, name, out);
  }
  return out;
}

std::string Parameters::describe_json_schema() const {
  debug_check(describing(), "only a description can be printed");
  std::string root = table_schema(impl_->description->root);
  JsonObject definitions;
  for (const auto& [name, table] : impl_->description->definitions)
    definitions.add(name, table_schema(*table));
  std::string head = R"({"$schema": "https://json-schema.org/draft/2020-12/schema", )";
  if (!definitions.empty()) head += R"("$defs": )" + definitions.text() + ", ";
  return indented(head + root.substr(1));
}

}  // namespace mpm
