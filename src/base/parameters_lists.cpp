#include <algorithm>

#include "mpm_hpc/base/parameters.hpp"
#include "parameters_impl.hpp"

namespace mpm {
namespace {

std::string json_list(const std::vector<std::string>& items) {
  return fmt::format("[{}]", fmt::join(items, ", "));
}

std::string json_list(const Real* values, std::size_t size) {
  std::vector<std::string> items;
  for (std::size_t i = 0; i < size; ++i) {
    items.push_back(json_number(values[i]));
    if (items.back().empty()) return {};
  }
  return json_list(items);
}

}  // namespace

bool Parameters::read_fixed(std::string_view key, Real* value, int size, const RealOptions& options,
                            bool has_default) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::vector,
                         .range = options,
                         .default_as = has_default && !options.required
                                           ? json_list(value, static_cast<std::size_t>(size))
                                           : "",
                         .components = size});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const SceneArray* array = node->array();
  if (!array || array->size() != static_cast<std::size_t>(size)) {
    const std::string found = array ? fmt::format("a list of {}", array->size()) : node->text();
    impl_->fault(node->location, fmt::format("{} must be a list of {} numbers, one per direction, not {}.",
                                             key, size, found));
    return false;
  }
  std::vector<Real> read(array->size());
  bool good = true;
  for (std::size_t i = 0; i < read.size(); ++i)
    good = number_of(*(*array)[i], fmt::format("{}[{}]", key, i), key, options, *impl_->session, read[i]) &&
           good;
  if (good) std::copy(read.begin(), read.end(), value);
  return good;
}

bool Parameters::vector(std::string_view key, std::vector<Real>& value, const RealOptions& options) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::vector,
                         .range = options,
                         .default_as = options.required ? "" : json_list(value.data(), value.size())});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const SceneArray* array = node->array();
  if (!array) {
    impl_->fault(node->location, fmt::format("{} must be a list of numbers, not {}.", key, node->text()));
    return false;
  }
  std::vector<Real> read(array->size());
  if (!read.empty() && !read_fixed(key, read.data(), static_cast<int>(read.size()), options, false))
    return false;
  value = std::move(read);
  return true;
}

bool Parameters::read_points(std::string_view key, std::vector<Real>& flat, int size,
                             const RealOptions& options) {
  if (describing()) {
    impl_->describe_key(
        {.key = std::string(key), .kind = ParameterKind::points, .range = options, .components = size});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const SceneArray* array = node->array();
  if (!array) {
    impl_->fault(node->location,
                 fmt::format("{} must be a list of points [[..], [..]], not {}.", key, node->text()));
    return false;
  }
  for (std::size_t i = 0; i < array->size(); ++i) {
    const SceneNode& point = *(*array)[i];
    const SceneArray* numbers = point.array();
    if (!numbers || numbers->size() != static_cast<std::size_t>(size)) {
      impl_->fault(point.location,
                   fmt::format("{}[{}] must be a point of {} numbers, not {}.", key, i, size,
                               numbers ? fmt::format("a list of {}", numbers->size()) : point.text()));
      return false;
    }
    for (std::size_t j = 0; j < numbers->size(); ++j) {
      flat.push_back(0);
      if (!number_of(*(*numbers)[j], fmt::format("{}[{}][{}]", key, i, j), key, options, *impl_->session,
                     flat.back()))
        return false;
    }
  }
  return true;
}

bool Parameters::text_list(std::string_view key, std::vector<std::string>& value,
                           const TextOptions& options) {
  if (describing()) {
    std::vector<std::string> quoted;
    for (const std::string& item : value) quoted.push_back(json_text(item));
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::text_list,
                         .range = as_range(options),
                         .default_as = options.required ? "" : json_list(quoted)});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const SceneArray* array = node->array();
  if (!array) {
    impl_->fault(node->location, fmt::format("{} must be a list of texts, not {}.", key, node->text()));
    return false;
  }
  std::vector<std::string> read;
  for (const auto& element : *array) {
    const auto* text = std::get_if<std::string>(&element->value);
    if (!text) {
      impl_->fault(element->location,
                   fmt::format("{} must hold texts in quotes, not {}.", key, element->text()));
      return false;
    }
    if (std::find(read.begin(), read.end(), *text) != read.end()) {
      impl_->fault(element->location, fmt::format("{} names \"{}\" twice; take one of the two out.", key, *text));
      return false;
    }
    read.push_back(*text);
  }
  value = std::move(read);
  return true;
}

bool Parameters::integer_list(std::string_view key, std::vector<std::int64_t>& value,
                              const IntegerOptions& options) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::integer_list,
                         .range = as_range(options),
                         .default_as = options.required ? "" : fmt::format("[{}]", fmt::join(value, ", "))});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const SceneArray* array = node->array();
  if (!array) {
    impl_->fault(node->location,
                 fmt::format("{} must be a list of whole numbers, not {}.", key, node->text()));
    return false;
  }
  std::vector<std::int64_t> read(array->size());
  for (std::size_t i = 0; i < read.size(); ++i)
    if (!integer_of(*(*array)[i], fmt::format("{}[{}]", key, i), options, *impl_->session, read[i]))
      return false;
  value = std::move(read);
  return true;
}

}  // namespace mpm
