// The verification table: each number beside what theory or a published result expects. Lines go to stdout and, when
// MPM_VERIFICATION names a folder, to files that apps/mpm_verify makes a report of.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <string>
#include <vector>

#include "mpm_hpc/base/types.hpp"
#include "support/mpi_test.hpp"

namespace mpm::test {

// What a number may be.
struct Band {
  Real lower, upper;
  std::string text;
};
inline Band within(Real expected, Real relative) {
  const Real room = relative * std::abs(expected);
  return {expected - room, expected + room, fmt::format("{:.6g} within {:.3g} %", expected, 100 * relative)};
}
inline Band between(Real lower, Real upper) { return {lower, upper, fmt::format("{:.6g} to {:.6g}", lower, upper)}; }
inline Band at_most(Real upper) {
  return {-std::numeric_limits<Real>::infinity(), upper, fmt::format("<= {:.3g}", upper)};
}
inline Band at_least(Real lower) {
  return {lower, std::numeric_limits<Real>::infinity(), fmt::format(">= {:.4g}", lower)};
}

namespace detail {

inline std::string json_text(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') out += '\\';
    out += c;
  }
  return out + "\"";
}

inline std::string verification_file(const std::string& ending) {
  const char* folder = std::getenv("MPM_VERIFICATION");
  if (!folder || rank() != 0) return {};
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  return fmt::format("{}/{}.{}_{}{}", folder, test->test_suite_name(), test->name(), size(), ending);
}

inline void write_figure(const std::string& section, const std::string& name, Real value, const Band& band,
                         const std::string& unit, const std::string& short_because) {
  const bool inside = value >= band.lower && value <= band.upper;
  if (rank() == 0)
    std::printf("%s: %s = %.6g %s (expected %s)%s\n", section.c_str(), name.c_str(), value, unit.c_str(),
                band.text.c_str(), inside ? "" : short_because.empty() ? " FAILS" : " falls short");
  const std::string file = verification_file(".jsonl");
  if (file.empty()) return;
  std::ofstream(file, std::ios::app) << fmt::format(
      "{{\"section\": {}, \"name\": {}, \"value\": {:.9g}, \"unit\": {}, \"expected\": {}, \"inside\": {}, "
      "\"short_because\": {}, \"ranks\": {}}}\n",
      json_text(section), json_text(name), std::isfinite(value) ? value : -1e300, json_text(unit),
      json_text(band.text), inside, json_text(short_because), size());
}

}  // namespace detail

// section: as in "3 elastodynamics"; value and band in the same unit. The value is the same on all ranks.
inline void verify(const std::string& section, const std::string& name, Real value, const Band& band,
                   const std::string& unit = "") {
  detail::write_figure(section, name, value, band, unit, "");
  EXPECT_GE(value, band.lower) << section << ": " << name;
  EXPECT_LE(value, band.upper) << section << ": " << name;
}

// For a number that is known to fall short of the band, with the reason: it stays in the table, and `floor` holds what has
// been reached.
inline void verify_short(const std::string& section, const std::string& name, Real value, const Band& band,
                         const Band& reached, const std::string& reason, const std::string& unit = "") {
  detail::write_figure(section, name, value, band, unit, reason);
  EXPECT_GE(value, reached.lower) << section << ": " << name;
  EXPECT_LE(value, reached.upper) << section << ": " << name;
}

// A curve for the report: columns by name, the first along the axis; those that begin with "reference" are drawn as marks.
struct Curve {
  std::string name;
  bool logarithmic = false;
  std::vector<std::string> columns;
  std::vector<std::vector<Real>> rows;

  // Writes it, where a report is made.
  void write() const {
    const std::string file = detail::verification_file("." + name + ".csv");
    if (file.empty()) return;
    std::ofstream out(file);
    out << "# " << (logarithmic ? "log" : "linear") << "\n" << fmt::format("{}\n", fmt::join(columns, ","));
    for (const auto& row : rows) out << fmt::format("{:.9g}\n", fmt::join(row, ","));
  }
};

}  // namespace mpm::test
