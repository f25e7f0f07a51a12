// What stands behind Parameters: the scene with its pending errors when reading, the collected rows when
// describing.
#pragma once

#include <fmt/format.h>

#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/parameters.hpp"
#include "scene_tree.hpp"

namespace mpm {

struct PendingError {
  Location location;
  std::string message;
  bool is_missing_key;  // reported last: a misspelt key explains a missing one
};

// One scene being read; shared by the Parameters of all its tables.
struct SceneSession {
  std::string file_name;
  std::string text;
  std::unique_ptr<SceneNode> root;
  std::vector<PendingError> pending;
  std::vector<std::pair<std::string, FormulaText>> definitions;  // that formulas may use

  void throw_pending();  // the first in file order, if there is one
  [[noreturn]] void throw_now(const Location& location, const std::string& message);
};

enum class ParameterKind {
  real,
  integer,
  boolean,
  text,
  choice,
  vector,
  points,
  text_list,
  integer_list,
  formulas,
  definitions,
  section,
  section_list,
  named_sections
};

// "key is one of values".
struct Condition {
  std::string key;
  std::vector<std::string> values;
};

struct DescribedTable;

struct DescribedKey {
  std::string key;
  ParameterKind kind = ParameterKind::real;
  RealOptions range = {};       // unit, bounds, required, doc of every kind
  std::string default_as = {};  // as JSON; empty for none
  int components = 0;           // of a vector or point; 0 for any number
  int rows = 0;                 // that the components of formulas come in; 0 for a plain list
  std::vector<std::string> choices = {};
  std::vector<Condition> conditions = {};
  std::string definition = {};                    // of a section: its name in Description::definitions, or
  std::shared_ptr<DescribedTable> children = {};  // its keys
};

struct DescribedTable {
  std::vector<DescribedKey> keys;
};

struct Description {
  DescribedTable root;
  std::map<std::string, std::shared_ptr<DescribedTable>> definitions;
};

struct Parameters::Impl {
  // Reading.
  std::shared_ptr<SceneSession> session;
  const SceneTable* table = nullptr;  // null: absent
  Location location;                  // of the table, or of the nearest one above that exists
  std::vector<std::string> declared;
  std::vector<std::string> asked;  // by has(): no declarations, but what a slip may have meant
  // Describing.
  std::shared_ptr<Description> description;
  DescribedTable* described = nullptr;
  std::vector<Condition> conditions;
  // Both.
  std::string path;

  bool describing() const { return description != nullptr; }
  void describe_key(DescribedKey row) {
    row.conditions = conditions;
    described->keys.push_back(std::move(row));
  }
  // The value of a key, null if absent; remembers the key as known and a missing required one as an error.
  const SceneNode* find(std::string_view key, bool required, const std::string& doc);
  std::string table_name() const { return path.empty() ? "the scene" : "[" + path + "]"; }
  std::string path_of(std::string_view key) const {
    return path.empty() ? std::string(key) : path + "." + std::string(key);
  }
  void fault(const Location& location, std::string message) {
    session->pending.push_back({location, std::move(message), false});
  }
  Parameters child(const std::string& key_path, const SceneNode* node) const;
  Parameters described_child(const std::string& key_path, DescribedTable* children) const;
  void run(Parameters& q, const Section& callback) const;
  void declare_section(std::string_view key, ParameterKind kind, const SectionOptions& options,
                       const std::string& placeholder, const Section& callback);
};

// Read one value; after a fault, which stays pending, they return false.
bool number_of(const SceneNode& node, const std::string& name, std::string_view key,
               const RealOptions& options, SceneSession& session, Real& result);
bool integer_of(const SceneNode& node, const std::string& name, const IntegerOptions& options,
                SceneSession& session, std::int64_t& result);

RealOptions as_range(const IntegerOptions& options);
RealOptions as_range(const TextOptions& options);

// "> 0 kg/m^3", ">= -1 and < 0.5"; empty without bounds.
std::string range_text(const RealOptions& range);

std::string json_text(std::string_view text);  // quoted and escaped
std::string json_number(double value);         // empty for infinities and NaN

}  // namespace mpm
