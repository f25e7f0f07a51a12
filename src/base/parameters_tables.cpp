#include <algorithm>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/base/text.hpp"
#include "parameters_impl.hpp"

namespace mpm {

void SceneSession::throw_pending() {
  if (pending.empty()) return;
  const auto first = std::min_element(pending.begin(), pending.end(), [](const auto& a, const auto& b) {
    if (a.is_missing_key != b.is_missing_key) return b.is_missing_key;
    return comes_before(a.location, b.location);
  });
  throw UserError(first->location.text() + ": " + first->message);
}

void SceneSession::throw_now(const Location& location, const std::string& message) {
  pending.push_back({location, message, false});
  throw_pending();
  throw LogicError("an error was pending");
}

const SceneNode* Parameters::Impl::find(std::string_view key, bool required, const std::string& doc) {
  declared.emplace_back(key);
  const SceneMember* member = table ? table->find(key) : nullptr;
  if (member) return member->value.get();
  if (!required) return nullptr;
  const std::string what = doc.empty() ? std::string() : fmt::format(" ({})", doc);
  std::string message = fmt::format("{} lacks the required key \"{}\"{}; add {} = ... there.", table_name(),
                                    key, what, path_of(key));
  Location place = location;
  if (table) {
    std::vector<std::string> undeclared;
    for (const SceneMember& other : table->members)
      if (std::find(declared.begin(), declared.end(), other.key) == declared.end())
        undeclared.push_back(other.key);
    if (const std::string near = nearest_word(key, undeclared); !near.empty()) {
      place = table->find(near)->key_location;
      message = fmt::format("{} lacks the required key \"{}\"{}; is \"{}\" a slip of it?", table_name(), key,
                            what, near);
    }
  }
  session->pending.push_back({place, std::move(message), true});
  return nullptr;
}

Parameters Parameters::Impl::child(const std::string& key_path, const SceneNode* node) const {
  auto impl = std::make_unique<Impl>();
  impl->session = session;
  impl->path = key_path;
  impl->table = node ? node->table() : nullptr;
  impl->location = node ? node->location : location;
  return Parameters(std::move(impl));
}

Parameters Parameters::Impl::described_child(const std::string& key_path, DescribedTable* children) const {
  auto impl = std::make_unique<Impl>();
  impl->description = description;
  impl->described = children;
  impl->path = key_path;
  return Parameters(std::move(impl));
}

// What a component throws after a fault of the scene, which it read as its default, is only a consequence.
void Parameters::Impl::run(Parameters& q, const Section& callback) const {
  try {
    callback(q);
  } catch (...) {
    if (session) session->throw_pending();
    throw;
  }
  q.finish();
}

void Parameters::Impl::declare_section(std::string_view key, ParameterKind kind,
                                       const SectionOptions& options, const std::string& placeholder,
                                       const Section& callback) {
  DescribedKey row{.key = std::string(key),
                   .kind = kind,
                   .range = {.required = options.required, .doc = options.doc},
                   .definition = options.definition};
  std::shared_ptr<DescribedTable> children;
  std::string child_path = path_of(key) + placeholder;
  if (options.definition.empty()) {
    row.children = children = std::make_shared<DescribedTable>();
  } else if (!description->definitions.contains(options.definition)) {
    children = std::make_shared<DescribedTable>();
    description->definitions[options.definition] = children;
    child_path = options.definition;
  }
  describe_key(std::move(row));
  if (!children) return;  // described already, or being described by a table above
  Parameters q = described_child(child_path, children.get());
  run(q, callback);
}

bool Parameters::section(std::string_view key, const SectionOptions& options, const Section& callback) {
  if (describing()) {
    impl_->declare_section(key, ParameterKind::section, options, "", callback);
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node && options.required) impl_->session->throw_pending();
  if (node && !node->table())
    impl_->session->throw_now(node->location,
                              fmt::format("{} must be a table, written [{}] or {} = {{...}}, not {}.", key,
                                          impl_->path_of(key), key, node->text()));
  Parameters q = impl_->child(impl_->path_of(key), node);
  impl_->run(q, callback);
  return node != nullptr;
}

int Parameters::section_list(std::string_view key, const SectionOptions& options,
                             const IndexedSection& callback) {
  if (describing()) {
    impl_->declare_section(key, ParameterKind::section_list, options, "[]",
                           [&](Parameters& q) { callback(q, 0); });
    return 0;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node && options.required) impl_->session->throw_pending();
  if (!node) return 0;
  const std::string form =
      fmt::format("a list of tables, written [[{}]] or {} = [{{...}}, ...]", impl_->path_of(key), key);
  const SceneArray* array = node->array();
  if (!array)
    impl_->session->throw_now(node->location, fmt::format("{} must be {}, not {}.", key, form, node->text()));
  if (array->empty() && options.required)
    impl_->session->throw_now(node->location,
                              fmt::format("{} is empty; give {} with one entry at least.", key, form));
  int index = 0;
  for (const auto& element : *array) {
    if (!element->table())
      impl_->session->throw_now(element->location, fmt::format("{} must be {}, but entry {} is {}.", key,
                                                               form, index, element->text()));
    Parameters q = impl_->child(fmt::format("{}.{}", impl_->path_of(key), index), element.get());
    impl_->run(q, [&](Parameters& p) { callback(p, index); });
    ++index;
  }
  return index;
}

int Parameters::named_sections(std::string_view key, const SectionOptions& options,
                               const NamedSection& callback) {
  if (describing()) {
    impl_->declare_section(key, ParameterKind::named_sections, options, ".NAME",
                           [&](Parameters& q) { callback(q, "NAME"); });
    return 0;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node && options.required) impl_->session->throw_pending();
  if (!node) return 0;
  const std::string form = fmt::format("tables with names, written [{}.NAME]", impl_->path_of(key));
  if (!node->table())
    impl_->session->throw_now(node->location, fmt::format("{} must be {}, not {}.", key, form, node->text()));
  int count = 0;
  for (const SceneMember& member : node->table()->members) {
    if (!member.value->table())
      impl_->session->throw_now(member.key_location, fmt::format("{} must hold {}, but {} is {}.", key, form,
                                                                 member.key, member.value->text()));
    Parameters q = impl_->child(impl_->path_of(key) + "." + member.key, member.value.get());
    impl_->run(q, [&](Parameters& p) { callback(p, member.key); });
    ++count;
  }
  return count;
}

void Parameters::when(std::string_view key, const std::string& value,
                      const std::vector<std::string>& variants, const std::function<void()>& declarations) {
  if (describing()) {
    impl_->conditions.push_back({std::string(key), variants});
    declarations();
    impl_->conditions.pop_back();
  } else if (std::find(variants.begin(), variants.end(), value) != variants.end()) {
    declarations();
  }
}

bool Parameters::has(std::string_view key) const {
  if (describing()) return true;
  impl_->asked.emplace_back(key);
  return impl_->table && impl_->table->find(key) != nullptr;
}

bool Parameters::describing() const { return impl_->describing(); }

void Parameters::finish() {
  if (describing()) return;
  if (impl_->table) {
    std::vector<std::string> candidates = impl_->declared;
    candidates.insert(candidates.end(), impl_->asked.begin(), impl_->asked.end());
    for (const SceneMember& member : impl_->table->members) {
      const auto& declared = impl_->declared;
      if (std::find(declared.begin(), declared.end(), member.key) != declared.end()) continue;
      const std::string near = nearest_word(member.key, candidates);
      impl_->fault(member.key_location,
                   near.empty() ? fmt::format("unknown key \"{}\" in {}; the keys here are {}.", member.key,
                                              impl_->table_name(), fmt::join(declared, ", "))
                                : fmt::format("unknown key \"{}\" in {}; did you mean \"{}\"?", member.key,
                                              impl_->table_name(), near));
    }
  }
  impl_->session->throw_pending();
}

void Parameters::error_at(std::string_view key, const std::string& message) const {
  if (describing()) return;
  const SceneMember* member = impl_->table ? impl_->table->find(key) : nullptr;
  impl_->session->throw_now(member ? member->value->location : impl_->location, message);
}

std::string Parameters::where(std::string_view key) const {
  if (describing()) return impl_->path_of(key);
  const SceneMember* member = impl_->table ? impl_->table->find(key) : nullptr;
  return (member ? member->value->location : impl_->location).text();
}

std::string Parameters::path() const { return impl_->path; }

const std::string& Parameters::scene_text() const {
  debug_check(!describing(), "a description has no scene text");
  return impl_->session->text;
}

const std::string& Parameters::file_name() const {
  debug_check(!describing(), "a description has no scene file");
  return impl_->session->file_name;
}

std::filesystem::path Parameters::resolve(const std::string& relative_path) const {
  return std::filesystem::path(file_name()).parent_path() / relative_path;
}

}  // namespace mpm
