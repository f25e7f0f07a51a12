// Dimensional analysis of quantities written with units, such as "32 GPa" or "3 J/m^2".
#pragma once

#include <array>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include "mpm_hpc/base/types.hpp"

namespace mpm {

// Powers of length, mass, time, temperature, electric current and plane angle; halves occur (Pa m^0.5).
struct Dimension {
  std::array<double, 6> power{};

  friend Dimension operator*(const Dimension& a, const Dimension& b);
  friend Dimension operator/(const Dimension& a, const Dimension& b);
  friend bool operator==(const Dimension& a, const Dimension& b);
  Dimension raised(double exponent) const;
  bool is_pure_number() const { return *this == Dimension{}; }
  std::string text() const;  // in SI base units: "kg/(m s^2)"
};

// value in this unit times factor = value in SI.
struct Unit {
  Real factor = 1;
  Dimension dimension;
};

struct Quantity {
  Real si = 0;  // value in SI
  Dimension dimension;
  bool has_unit = false;
};

// Text that is no unit or no quantity; the message is the reason, without a place.
struct UnitError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// "J/m^2", "kg m/s^2", "W/(m K)", "MPa sqrt(m)", "rev/min", "%"; SI prefixes on every unit that takes them.
// Throws UnitError.
Unit parse_unit(std::string_view text);

// A number, then a unit or nothing. Throws UnitError.
Quantity parse_quantity(std::string_view text);

// Whether a quantity may stand where `expected` is asked: equal, or the angle left out (1/s for rad/s).
bool accepts(const Dimension& expected, const Dimension& given);

// `text` as a number in SI of the unit's dimension; throws UnitError that names what was expected.
Real quantity_in_si(std::string_view text, std::string_view expected_unit);

}  // namespace mpm
