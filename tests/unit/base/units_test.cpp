#include "mpm_hpc/base/units.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace mpm {
namespace {

constexpr Real pi = std::numbers::pi;

struct Row {
  const char* text;
  const char* unit;
  Real si;
};

// Expected values from the SI brochure's definitions.
TEST(Units, QuantitiesInSi) {
  const Row rows[] = {
      {"32 GPa", "Pa", 32e9},
      {"32GPa", "Pa", 32e9},
      {"3 J/m^2", "J/m^2", 3},
      {"3 N/m", "J/m^2", 3},
      {"2.7e-3 kN/mm", "J/m^2", 2700},
      {"0.25 mm", "m", 0.25e-3},
      {"80 us", "s", 80e-6},
      {"80 µs", "s", 80e-6},
      {"-9.81 m/s^2", "m/s^2", -9.81},
      {"+9.81 m s^-2", "m/s^2", 9.81},
      {"9.81 m/s²", "m/s^2", 9.81},
      {"20 deg", "rad", 20 * pi / 180},
      {"1 1/s", "1/s", 1},
      {"1 1/s", "rad/s", 1},
      {"5 1/ms", "1/s", 5000},
      {"60 rev/min", "rad/s", 2 * pi},
      {"60 rpm", "rad/s", 2 * pi},
      {"1.2 g/cm^3", "kg/m^3", 1200},
      {"7.8 t/m^3", "kg/m^3", 7800},
      {"2450 kg/m^3", "kg/m^3", 2450},
      {"2 MPa sqrt(m)", "Pa m^0.5", 2e6},
      {"2 MPa m^(1/2)", "Pa m^0.5", 2e6},
      {"3 W/(m K)", "W/(m K)", 3},
      {"4 kg*m/s/s", "N", 4},
      {"72 km/h", "m/s", 20},
      {"5 %", "", 0.05},
      {"0.3", "", 0.3},
      {"1 min", "s", 60},
      {"2 bar", "Pa", 2e5},
      {"1 in", "m", 0.0254},
      {"10 mPa s", "Pa s", 0.01},
  };
  for (const Row& row : rows)
    EXPECT_NEAR(quantity_in_si(row.text, row.unit), row.si, 4e-16 * std::abs(row.si) * 4) << row.text;
}

std::string reason(const char* text, const char* unit) {
  try {
    quantity_in_si(text, unit);
  } catch (const UnitError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Units, RefusalsNameWhatWasExpected) {
  EXPECT_EQ(reason("3 J/m^3", "J/m^2"), "\"3 J/m^3\" is in kg/(m s^2), but J/m^2 (kg/s^2) is expected");
  EXPECT_EQ(reason("3 kg", "m"), "\"3 kg\" is in kg, but m is expected");
  EXPECT_EQ(reason("3 m", ""), "\"3 m\" is in m, but a pure number is expected");
  EXPECT_EQ(reason("3 rad/s", "1/s"), "\"3 rad/s\" is in rad/s, but 1/s is expected");
  EXPECT_EQ(reason("32 Gpa", "Pa"), "'Gpa' is no unit; did you mean GPa?");
  EXPECT_NE(reason("1 furlong", "m").find("'furlong' is no unit"), std::string::npos);
  EXPECT_NE(reason("3", "Pa").find("has no unit, Pa is expected"), std::string::npos);
  EXPECT_NE(reason("fast", "m/s").find("is no number with a unit"), std::string::npos);
  EXPECT_NE(reason("1 W/m K", "W/(m K)").find("ambiguous"), std::string::npos);
  for (const char* bad : {"1 m^", "1 m/", "1 (m", "1 m)", "1 m^(1/0)", "1 m^99", "1e999 m", "1 m m2"})
    EXPECT_NE(reason(bad, "m"), "accepted") << bad;
}

TEST(Units, DimensionsMultiplyAndDivide) {
  EXPECT_EQ(parse_unit("J").dimension, parse_unit("N m").dimension);
  EXPECT_EQ(parse_unit("Pa").dimension, parse_unit("J/m^3").dimension);
  EXPECT_EQ(parse_unit("W s/J").dimension, Dimension{});
  EXPECT_EQ(parse_unit("sqrt(Pa/(kg/m^3))").dimension, parse_unit("m/s").dimension);
  EXPECT_EQ(parse_unit("m^(1/3)").dimension.raised(3), parse_unit("m").dimension);
  EXPECT_FALSE(parse_unit("N").dimension == parse_unit("Pa").dimension);
}

}  // namespace
}  // namespace mpm
