#include "mpm_hpc/base/units.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <numbers>
#include <vector>

#include "mpm_hpc/base/text.hpp"

namespace mpm {
namespace {

struct NamedUnit {
  std::string_view name;
  Real factor;
  std::array<double, 6> power;  // m, kg, s, K, A, rad
  bool takes_prefix;
};

constexpr Real pi = std::numbers::pi;
const std::vector<NamedUnit> units = {
    {"m", 1, {1, 0, 0, 0, 0, 0}, true},
    {"g", 1e-3, {0, 1, 0, 0, 0, 0}, true},
    {"s", 1, {0, 0, 1, 0, 0, 0}, true},
    {"K", 1, {0, 0, 0, 1, 0, 0}, true},
    {"A", 1, {0, 0, 0, 0, 1, 0}, true},
    {"rad", 1, {0, 0, 0, 0, 0, 1}, true},
    {"N", 1, {1, 1, -2, 0, 0, 0}, true},
    {"Pa", 1, {-1, 1, -2, 0, 0, 0}, true},
    {"J", 1, {2, 1, -2, 0, 0, 0}, true},
    {"W", 1, {2, 1, -3, 0, 0, 0}, true},
    {"Hz", 1, {0, 0, -1, 0, 0, 0}, true},
    {"L", 1e-3, {3, 0, 0, 0, 0, 0}, true},
    {"l", 1e-3, {3, 0, 0, 0, 0, 0}, true},
    {"t", 1e3, {0, 1, 0, 0, 0, 0}, true},
    {"bar", 1e5, {-1, 1, -2, 0, 0, 0}, true},
    {"min", 60, {0, 0, 1, 0, 0, 0}, false},
    {"h", 3600, {0, 0, 1, 0, 0, 0}, false},
    {"deg", pi / 180, {0, 0, 0, 0, 0, 1}, false},
    {"°", pi / 180, {0, 0, 0, 0, 0, 1}, false},
    {"rev", 2 * pi, {0, 0, 0, 0, 0, 1}, false},
    {"rpm", pi / 30, {0, 0, -1, 0, 0, 1}, false},
    {"%", 0.01, {}, false},
    {"in", 0.0254, {1, 0, 0, 0, 0, 0}, false},
    {"ft", 0.3048, {1, 0, 0, 0, 0, 0}, false},
    {"psi", 6894.757293168361, {-1, 1, -2, 0, 0, 0}, false},
};

struct Prefix {
  std::string_view name;
  Real factor;
};
const std::vector<Prefix> prefixes = {
    {"T", 1e12}, {"G", 1e9},  {"M", 1e6},  {"k", 1e3},  {"h", 1e2},  {"da", 1e1}, {"d", 1e-1},
    {"c", 1e-2}, {"m", 1e-3}, {"u", 1e-6}, {"µ", 1e-6}, {"μ", 1e-6}, {"n", 1e-9}, {"p", 1e-12},
};

// Exact names win over prefixed ones: "min" is a minute, "Pa" no peta-ampere.
std::optional<Unit> find_unit(std::string_view name) {
  for (const NamedUnit& unit : units)
    if (unit.name == name) return Unit{unit.factor, {unit.power}};
  for (const Prefix& prefix : prefixes) {
    if (!name.starts_with(prefix.name)) continue;
    const std::string_view rest = name.substr(prefix.name.size());
    for (const NamedUnit& unit : units)
      if (unit.takes_prefix && unit.name == rest) return Unit{prefix.factor * unit.factor, {unit.power}};
  }
  return std::nullopt;
}

[[noreturn]] void unknown_unit(std::string_view name) {
  const std::string low = lower_case(name);
  for (const NamedUnit& unit : units) {
    if (lower_case(unit.name) == low)
      throw UnitError(fmt::format("'{}' is no unit; did you mean {}?", name, unit.name));
    for (const Prefix& prefix : prefixes) {
      const std::string whole = std::string(prefix.name) + std::string(unit.name);
      if (unit.takes_prefix && lower_case(whole) == low)
        throw UnitError(fmt::format("'{}' is no unit; did you mean {}?", name, whole));
    }
  }
  throw UnitError(
      fmt::format("'{}' is no unit; use SI units such as m, kg, s, N, Pa, J with SI prefixes", name));
}

// Recursive descent over: product := factor { ('*' | '/' | space) factor }; factor := atom [ '^' exponent ].
class UnitParser {
 public:
  explicit UnitParser(std::string_view text) : text_(text) {}

  Unit parse() {
    const Unit unit = product();
    skip_spaces();
    if (at_ < text_.size()) fail(fmt::format("'{}' is out of place", text_.substr(at_)));
    return unit;
  }

 private:
  Unit product() {
    Unit result = factor();
    bool divided = false;
    while (true) {
      const std::size_t before = at_;
      skip_spaces();
      if (at_ == text_.size() || text_[at_] == ')') return result;
      if (take("/")) {
        const Unit divisor = factor();
        result = {result.factor / divisor.factor, result.dimension / divisor.dimension};
        divided = true;
        continue;
      }
      const bool explicit_product = take("*") || take("·");
      if (!explicit_product && before == at_) fail(fmt::format("'{}' is out of place", text_.substr(at_)));
      if (!explicit_product && divided)
        fail("a space after a quotient is ambiguous, use brackets as in W/(m K)");
      const Unit other = factor();
      result = {result.factor * other.factor, result.dimension * other.dimension};
    }
  }

  Unit factor() {
    Unit unit = atom();
    double exponent = 1;
    if (take("²")) {
      exponent = 2;
    } else if (take("³")) {
      exponent = 3;
    } else if (take("^") || take("**")) {
      exponent = parse_exponent();
    }
    return {std::pow(unit.factor, exponent), unit.dimension.raised(exponent)};
  }

  Unit atom() {
    skip_spaces();
    if (take("(")) return bracket();
    if (take("1")) return {};
    std::size_t end = at_;
    while (end < text_.size() && is_unit_character(end)) ++end;
    const std::string_view name = text_.substr(at_, end - at_);
    if (name.empty()) fail("a unit is missing");
    at_ = end;
    if (name == "sqrt" && take("(")) {
      const Unit inside = bracket();
      return {std::sqrt(inside.factor), inside.dimension.raised(0.5)};
    }
    const auto unit = find_unit(name);
    if (!unit) unknown_unit(name);
    return *unit;
  }

  Unit bracket() {
    const Unit inside = product();
    skip_spaces();
    if (!take(")")) fail("a closing bracket is missing");
    return inside;
  }

  double parse_exponent() {
    if (!take("(")) return parse_number();
    double value = parse_number();
    if (take("/")) {
      const double divisor = parse_number();
      if (divisor == 0) fail("an exponent divides by zero");
      value /= divisor;
    }
    if (!take(")")) fail("a closing bracket is missing");
    return value;
  }

  double parse_number() {
    skip_spaces();
    take("+");
    double value = 0;
    const auto [end, error] = std::from_chars(text_.data() + at_, text_.data() + text_.size(), value);
    if (error != std::errc() || std::abs(value) > 12) fail("an exponent must be a number between -12 and 12");
    at_ = static_cast<std::size_t>(end - text_.data());
    skip_spaces();
    return value;
  }

  bool is_unit_character(std::size_t i) const {
    const auto c = static_cast<unsigned char>(text_[i]);
    if (std::isalpha(c) || c == '%') return true;
    // Bytes of UTF-8 sequences belong to a name, except those of the signs ·, ² and ³.
    if (c < 0x80) return false;
    for (std::string_view sign : {"·", "²", "³"})
      if (text_.substr(i).starts_with(sign)) return false;
    return true;
  }
  void skip_spaces() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }
  bool take(std::string_view token) {
    if (!text_.substr(at_).starts_with(token)) return false;
    at_ += token.size();
    return true;
  }
  [[noreturn]] void fail(const std::string& reason) const {
    throw UnitError(fmt::format("the unit '{}' can't be read: {}", text_, reason));
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

std::string power_text(std::string_view name, double power) {
  return power == 1 ? std::string(name) : fmt::format("{}^{:g}", name, power);
}

}  // namespace

Dimension operator*(const Dimension& a, const Dimension& b) {
  Dimension c;
  for (std::size_t i = 0; i < c.power.size(); ++i) c.power[i] = a.power[i] + b.power[i];
  return c;
}

Dimension operator/(const Dimension& a, const Dimension& b) { return a * b.raised(-1); }

bool operator==(const Dimension& a, const Dimension& b) {
  for (std::size_t i = 0; i < a.power.size(); ++i)
    if (std::abs(a.power[i] - b.power[i]) > 1e-9) return false;  // exponents such as 1/3 are rounded
  return true;
}

Dimension Dimension::raised(double exponent) const {
  Dimension c;
  for (std::size_t i = 0; i < c.power.size(); ++i) c.power[i] = power[i] * exponent;
  return c;
}

std::string Dimension::text() const {
  constexpr std::array<std::string_view, 6> names = {"m", "kg", "s", "K", "A", "rad"};
  std::vector<std::string> above, below;
  for (std::size_t i : {1u, 0u, 2u, 3u, 4u, 5u}) {  // mass first, as in kg/(m s^2)
    if (power[i] > 1e-9) above.push_back(power_text(names[i], power[i]));
    if (power[i] < -1e-9) below.push_back(power_text(names[i], -power[i]));
  }
  if (above.empty() && below.empty()) return "a pure number";
  std::string result = above.empty() ? "1" : fmt::format("{}", fmt::join(above, " "));
  if (below.size() == 1) result += "/" + below[0];
  if (below.size() > 1) result += fmt::format("/({})", fmt::join(below, " "));
  return result;
}

Unit parse_unit(std::string_view text) {
  const std::string_view unit = trimmed(text);
  return unit.empty() ? Unit{} : UnitParser(unit).parse();
}

Quantity parse_quantity(std::string_view text) {
  const std::string_view whole = trimmed(text);
  const std::string_view digits = whole.starts_with('+') ? whole.substr(1) : whole;
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error == std::errc::result_out_of_range)
    throw UnitError(fmt::format("\"{}\" is too large or too small", whole));
  if (error != std::errc())
    throw UnitError(fmt::format("\"{}\" is no number with a unit, such as \"32 GPa\"", text));
  const std::string_view rest = trimmed(digits.substr(static_cast<std::size_t>(end - digits.data())));
  const Unit unit = parse_unit(rest);
  return {value * unit.factor, unit.dimension, !rest.empty()};
}

bool accepts(const Dimension& expected, const Dimension& given) {
  if (expected == given) return true;
  Dimension without_angle = expected;
  without_angle.power[5] = 0;
  return without_angle == given;
}

Real quantity_in_si(std::string_view text, std::string_view expected_unit) {
  const Unit expected = parse_unit(expected_unit);
  const Quantity quantity = parse_quantity(text);
  const std::string wanted = expected_unit.empty() ? "a pure number" : std::string(expected_unit);
  if (!quantity.has_unit && !expected.dimension.is_pure_number())
    throw UnitError(
        fmt::format("\"{}\" has no unit, {} is expected; write the number without quotes for SI, or add "
                    "the unit",
                    text, wanted));
  if (!accepts(expected.dimension, quantity.dimension))
    throw UnitError(fmt::format("\"{}\" is in {}, but {}{} is expected", text, quantity.dimension.text(),
                                wanted,
                                expected.dimension.is_pure_number() || expected.dimension.text() == wanted
                                    ? ""
                                    : fmt::format(" ({})", expected.dimension.text())));
  return quantity.si / expected.factor;
}

}  // namespace mpm
