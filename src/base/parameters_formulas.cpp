#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/base/units.hpp"
#include "parameters_impl.hpp"

namespace mpm {
namespace {

// A quantity if it can be read as one of the expected unit, else a formula; `unit` null: of any unit.
bool read_formula(const SceneNode& node, const std::string& name, std::string_view key,
                  const RealOptions& options, bool any_unit, SceneSession& session, FormulaText& result) {
  const auto* text = std::get_if<std::string>(&node.value);
  if (!text) {
    if (!number_of(node, name, key, options, session, result.number)) return false;
    result.text.clear();
    result.where = node.location.text();
    return true;
  }
  result = {0, *text, node.location.text()};
  try {
    result.number = any_unit ? parse_quantity(*text).si : quantity_in_si(*text, options.unit);
  } catch (const UnitError&) {
    if (text->empty())
      session.pending.push_back({node.location, fmt::format("{} is empty; give a formula.", name), false});
    return !text->empty();
  }
  result.text.clear();
  return true;
}

}  // namespace

bool Parameters::formulas(std::string_view key, std::vector<FormulaText>& value, const RealOptions& options,
                          int row_length) {
  const int size = static_cast<int>(value.size()), rows = row_length > 0 ? size / row_length : 0;
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::formulas,
                         .range = options,
                         .components = size,
                         .rows = rows});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  std::vector<FormulaText> read;
  // One list; returns false after a fault.
  auto read_list = [&](const SceneNode& list, const std::string& name, int expected) {
    const SceneArray* array = list.array();
    if (!array || array->size() != static_cast<std::size_t>(expected)) {
      impl_->fault(list.location,
                   fmt::format("{} must be a list of {} numbers or formulas, not {}.", name, expected,
                               array ? fmt::format("a list of {}", array->size()) : list.text()));
      return false;
    }
    bool good = true;
    for (int i = 0; i < expected; ++i) {
      read.emplace_back();
      good = read_formula(*(*array)[i], fmt::format("{}[{}]", name, i), key, options, false, *impl_->session,
                          read.back()) &&
             good;
    }
    return good;
  };
  if (rows == 0) {
    if (!read_list(*node, std::string(key), size)) return false;
  } else {
    const SceneArray* array = node->array();
    if (!array || array->size() != static_cast<std::size_t>(rows)) {
      impl_->fault(
          node->location,
          fmt::format("{} must be a list of {} rows of {} numbers or formulas, not {}.", key, rows,
                      row_length, array ? fmt::format("a list of {}", array->size()) : node->text()));
      return false;
    }
    bool good = true;
    for (int i = 0; i < rows; ++i)
      good = read_list(*(*array)[i], fmt::format("{}[{}]", key, i), row_length) && good;
    if (!good) return false;
  }
  value = std::move(read);
  return true;
}

bool Parameters::define_formulas(std::string_view key, const std::string& doc) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key), .kind = ParameterKind::definitions, .range = {.doc = doc}});
    return false;
  }
  const SceneNode* node = impl_->find(key, false, doc);
  if (!node) return false;
  if (!node->table()) {
    impl_->fault(node->location, fmt::format("{} must be a table of formulas, not {}.", key, node->text()));
    return false;
  }
  for (const SceneMember& member : node->table()->members) {
    FormulaText formula;
    if (read_formula(*member.value, impl_->path_of(key) + "." + member.key, key, {}, true, *impl_->session,
                     formula))
      impl_->session->definitions.emplace_back(member.key, std::move(formula));
  }
  return true;
}

const std::vector<std::pair<std::string, FormulaText>>& Parameters::definitions() const {
  static const std::vector<std::pair<std::string, FormulaText>> none;
  return describing() ? none : impl_->session->definitions;
}

}  // namespace mpm
