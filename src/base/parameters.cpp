#include "mpm_hpc/base/parameters.hpp"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>

#include "mpm_hpc/base/text.hpp"
#include "mpm_hpc/base/units.hpp"
#include "parameters_impl.hpp"

namespace mpm {
namespace {

std::string unit_hint(const std::string& unit) {
  return unit.empty() ? std::string("a number")
                      : fmt::format("a number in {} or a text such as \"1 {}\"", unit, unit);
}

// The sentence about a value outside of its range; empty if inside. `what` is "density = -1".
std::string range_fault(double value, const RealOptions& range, const std::string& what,
                        std::string_view key) {
  const bool low = range.min_exclusive ? value <= range.min : value < range.min;
  const bool high = range.max_exclusive ? value >= range.max : value > range.max;
  if (!low && !high) return {};
  const std::string bound = fmt::format("{}", low ? range.min : range.max);
  std::string remedy;
  if (low && range.min == 0)
    remedy = fmt::format("give a {} {}", range.min_exclusive ? "positive" : "non-negative", key);
  else if (low)
    remedy = fmt::format("give a value {} {}", range.min_exclusive ? "above" : "of at least", bound);
  else
    remedy = fmt::format("give a value {} {}", range.max_exclusive ? "below" : "of at most", bound);
  if (high && range.unit == "rad") remedy += fmt::format("; degrees are written {} = \"30 deg\"", key);
  return fmt::format("{} is {} the allowed range ({}); {}.", what, low ? "below" : "above", range_text(range),
                     remedy);
}

}  // namespace

RealOptions as_range(const IntegerOptions& options) {
  RealOptions range{.required = options.required, .doc = options.doc};
  if (options.min > std::numeric_limits<std::int64_t>::min()) range.min = static_cast<Real>(options.min);
  if (options.max < std::numeric_limits<std::int32_t>::max()) range.max = static_cast<Real>(options.max);
  return range;
}

RealOptions as_range(const TextOptions& options) {
  return {.required = options.required, .doc = options.doc};
}

bool number_of(const SceneNode& node, const std::string& name, std::string_view key,
               const RealOptions& options, SceneSession& session, Real& result) {
  const auto fault = [&](std::string message) {
    session.pending.push_back({node.location, std::move(message), false});
    return false;
  };
  Real value = 0;
  if (const auto* number = std::get_if<double>(&node.value)) {
    value = *number;
  } else if (const auto* integer = std::get_if<std::int64_t>(&node.value)) {
    value = static_cast<Real>(*integer);
  } else if (const auto* text = std::get_if<std::string>(&node.value)) {
    try {
      value = quantity_in_si(*text, options.unit);
    } catch (const UnitError& error) {
      return fault(fmt::format("{}: {}.", name, error.what()));
    }
  } else {
    return fault(fmt::format("{} must be {}, not {}.", name, unit_hint(options.unit), node.text()));
  }
  const std::string what = fmt::format("{} = {}", name, node.text());
  if (!std::isfinite(value)) return fault(fmt::format("{} is not finite; give an ordinary number.", what));
  if (std::string reason = range_fault(value, options, what, key); !reason.empty())
    return fault(std::move(reason));
  result = value;
  return true;
}

bool integer_of(const SceneNode& node, const std::string& name, const IntegerOptions& options,
                SceneSession& session, std::int64_t& result) {
  std::int64_t integer = 0;
  const auto* number = std::get_if<double>(&node.value);
  if (const auto* exact = std::get_if<std::int64_t>(&node.value)) {
    integer = *exact;
  } else if (number && std::floor(*number) == *number && std::abs(*number) < 9e15) {
    integer = static_cast<std::int64_t>(*number);  // 1e6 is a fair way to write a million
  } else {
    session.pending.push_back(
        {node.location, fmt::format("{} must be a whole number, not {}.", name, node.text()), false});
    return false;
  }
  if (integer < options.min || integer > options.max) {
    RealOptions range = as_range(options);
    range.max = static_cast<Real>(options.max);
    session.pending.push_back(
        {node.location,
         range_fault(static_cast<Real>(integer), range, fmt::format("{} = {}", name, integer), name), false});
    return false;
  }
  result = integer;
  return true;
}

std::string range_text(const RealOptions& range) {
  std::string result;
  if (std::isfinite(range.min)) result = fmt::format("{} {}", range.min_exclusive ? ">" : ">=", range.min);
  if (std::isfinite(range.max))
    result +=
        fmt::format("{}{} {}", result.empty() ? "" : " and ", range.max_exclusive ? "<" : "<=", range.max);
  if (!result.empty() && !range.unit.empty()) result += " " + range.unit;
  return result;
}

Parameters::Parameters(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Parameters::Parameters(Parameters&&) noexcept = default;
Parameters& Parameters::operator=(Parameters&&) noexcept = default;
Parameters::~Parameters() = default;

Parameters Parameters::read_file(const std::filesystem::path& file,
                                 const std::vector<std::string>& overrides) {
  require(!std::filesystem::is_directory(file), "{}: this is a folder, not a scene; name a .toml file.",
          file.string());
  std::ifstream stream(file, std::ios::binary);
  require(stream.good(), "{}: the scene can't be opened; check the path and that the file is readable.",
          file.string());
  std::ostringstream text;
  text << stream.rdbuf();
  return read_text(std::move(text).str(), file.string(), overrides);
}

Parameters Parameters::read_text(std::string text, std::string file_name,
                                 const std::vector<std::string>& overrides) {
  auto impl = std::make_unique<Impl>();
  impl->session = std::make_shared<SceneSession>();
  impl->session->root = parse_scene(text, file_name);
  for (const std::string& assignment : overrides) apply_override(*impl->session->root, assignment);
  impl->session->text = std::move(text);
  impl->session->file_name = file_name;
  impl->table = impl->session->root->table();
  impl->location = {file_name, 1, 1};
  return Parameters(std::move(impl));
}

Parameters Parameters::describe() {
  auto impl = std::make_unique<Impl>();
  impl->description = std::make_shared<Description>();
  impl->described = &impl->description->root;
  return Parameters(std::move(impl));
}

bool Parameters::read_real(std::string_view key, Real& value, const RealOptions& options, bool has_default) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::real,
                         .range = options,
                         .default_as = has_default && !options.required ? json_number(value) : ""});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  return node && number_of(*node, std::string(key), key, options, *impl_->session, value);
}

bool Parameters::real(std::string_view key, Real& value, const RealOptions& options) {
  return read_real(key, value, options, true);
}

bool Parameters::optional_real(std::string_view key, std::optional<Real>& value, const RealOptions& options) {
  Real number = value.value_or(0);
  const bool given = read_real(key, number, options, value.has_value());
  if (given) value = number;
  return given;
}

bool Parameters::read_integer(std::string_view key, std::int64_t& value, const IntegerOptions& options,
                              bool has_default) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::integer,
                         .range = as_range(options),
                         .default_as = has_default && !options.required ? fmt::format("{}", value) : ""});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  return node && integer_of(*node, std::string(key), options, *impl_->session, value);
}

bool Parameters::optional_integer(std::string_view key, std::optional<std::int64_t>& value,
                                  const IntegerOptions& options) {
  std::int64_t number = value.value_or(0);
  const bool given = read_integer(key, number, options, value.has_value());
  if (given) value = number;
  return given;
}

bool Parameters::boolean(std::string_view key, bool& value, const TextOptions& options) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::boolean,
                         .range = as_range(options),
                         .default_as = options.required ? "" : (value ? "true" : "false")});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const auto* flag = std::get_if<bool>(&node->value);
  if (!flag) {
    impl_->fault(node->location, fmt::format("{} must be true or false, not {}.", key, node->text()));
    return false;
  }
  value = *flag;
  return true;
}

bool Parameters::optional_text(std::string_view key, std::optional<std::string>& value,
                               const TextOptions& options) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::text,
                         .range = as_range(options),
                         .default_as = value && !options.required ? json_text(*value) : ""});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) return false;
  const auto* text = std::get_if<std::string>(&node->value);
  if (!text) {
    impl_->fault(node->location, fmt::format("{} must be a text in quotes, not {}.", key, node->text()));
    return false;
  }
  value = *text;
  return true;
}

bool Parameters::text(std::string_view key, std::string& value, const TextOptions& options) {
  std::optional<std::string> read = value;
  const bool given = optional_text(key, read, options);
  if (given) value = *read;
  return given;
}

bool Parameters::choice(std::string_view key, std::string& value, const std::vector<std::string>& choices,
                        const TextOptions& options) {
  if (describing()) {
    impl_->describe_key({.key = std::string(key),
                         .kind = ParameterKind::choice,
                         .range = as_range(options),
                         .default_as = options.required || value.empty() ? "" : json_text(value),
                         .choices = choices});
    return false;
  }
  const SceneNode* node = impl_->find(key, options.required, options.doc);
  if (!node) {
    if (options.required) impl_->session->throw_pending();
    return false;
  }
  const auto* text = std::get_if<std::string>(&node->value);
  if (!text || std::find(choices.begin(), choices.end(), *text) == choices.end()) {
    const std::string near = text ? nearest_word(*text, choices) : std::string();
    impl_->session->throw_now(
        node->location, fmt::format("{} = {} is no choice; {}choose one of \"{}\".", key, node->text(),
                                    near.empty() ? "" : fmt::format("did you mean \"{}\"? If not, ", near),
                                    fmt::join(choices, "\", \"")));
  }
  value = *text;
  return true;
}

}  // namespace mpm
