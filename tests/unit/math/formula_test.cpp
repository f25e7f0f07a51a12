#include "mpm_hpc/math/formula.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "mpm_hpc/base/error.hpp"
#include "support/heap_counter.hpp"

using namespace mpm;

namespace {

constexpr Real pi = 3.14159265358979323846;

struct Read {
  Formulas velocity, gradient;
};

Read read(const std::string& text) {
  Parameters p = Parameters::read_text(text, "scene.toml");
  declare_definitions(p);
  Read result;
  declare_formulas(p, "velocity", {"x", "y", "t"}, 2, result.velocity, {.unit = "m/s", .min = -100});
  declare_formulas(p, "gradient", {"x", "y"}, 4, result.gradient, {}, 2);
  p.finish();
  return result;
}

std::string fault(const std::string& text) {
  try {
    read(text);
  } catch (const UserError& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "accepted";
}

Vec<2> at(const Formulas& f, Real x, Real y, Real t) {
  const Real values[3] = {x, y, t};
  Vec<2> result;
  f.evaluate(values, result.data());
  return result;
}

TEST(Formulas, NumbersQuantitiesAndExpressions) {
  const Read none = read("");
  EXPECT_EQ(at(none.velocity, 1, 2, 3), Vec<2>(0, 0));
  EXPECT_TRUE(none.velocity.constant());
  EXPECT_EQ(at(read("velocity = [3, \"2 km/s\"]").velocity, 0, 0, 0), Vec<2>(3, 2000));
  // A number in quotes is one in SI, as in a formula.
  EXPECT_EQ(at(read("velocity = [\"0\", \"2\"]").velocity, 0, 0, 0), Vec<2>(0, 2));

  const Read r = read("velocity = [\"0.1*sin(pi*x/50) + t^2\", \"x < y ? -1 : atan2(y, x)\"]");
  EXPECT_FALSE(r.velocity.constant());
  EXPECT_TRUE(r.velocity.uses("x") && r.velocity.uses("y") && r.velocity.uses("t"));
  EXPECT_NEAR(at(r.velocity, 7, 2, 3)[0], 0.1 * std::sin(pi * 7 / 50) + 9, 1e-15);
  EXPECT_NEAR(at(r.velocity, 7, 2, 3)[1], std::atan2(2, 7), 1e-15);
  EXPECT_EQ(at(r.velocity, 1, 2, 0)[1], -1);
  EXPECT_TRUE(std::isinf(at(read("velocity = [\"1/x\", 0]").velocity, 0, 0, 0)[0]));
}

TEST(Formulas, RowsAreReadRowByRow) {
  const Read r = read("gradient = [[1, \"2*x\"], [\"y\", 4]]");
  const Real values[2] = {5, 7};
  Real result[4];
  r.gradient.evaluate(values, result);
  EXPECT_EQ(result[0], 1);
  EXPECT_EQ(result[1], 10);
  EXPECT_EQ(result[2], 7);
  EXPECT_EQ(result[3], 4);
}

TEST(Formulas, DefinitionsUseEachOther) {
  // In any order; one that is used twice is evaluated once, and what nobody uses asks for no variable.
  const Read r = read(R"toml(velocity = ["A*wave", "R - twice"]
[define]
wave = "sin(twice)"
twice = "2*R"
R = "sqrt(x^2 + y^2)"
A = "5 mm"
start = "X + Y + Z"
)toml");
  EXPECT_NEAR(at(r.velocity, 3, 4, 0)[0], 0.005 * std::sin(10), 1e-17);
  // What doesn't vary is found once, through other definitions too.
  const Read constant =
      read("velocity = [\"2*c\", \"c*x\"]\n[define]\nc = \"b + 1\"\nb = \"sqrt(a)\"\na = 9");
  EXPECT_EQ(at(constant.velocity, 5, 0, 0), Vec<2>(8, 20));
  EXPECT_EQ(at(constant.velocity, 6, 0, 0), Vec<2>(8, 24));
  EXPECT_TRUE(read("velocity = [\"pi\", \"c\"]\n[define]\nc = \"2*pi\"").velocity.constant());
  EXPECT_NEAR(at(r.velocity, 3, 4, 0)[1], -5, 1e-15);
  EXPECT_TRUE(r.velocity.uses("x"));
  EXPECT_FALSE(r.velocity.uses("t"));
}

TEST(Formulas, FaultsNamePlaceAndRemedy) {
  EXPECT_EQ(fault("velocity = [\"0.1*sin(pi*q)\", 0]"),
            "scene.toml:1:13: the formula \"0.1*sin(pi*q)\": there is no \"q\" here; the names are x, y, t, "
            "pi and functions "
            "such as sin.");
  EXPECT_EQ(fault("velocity = [\"0.1*sni(x)\", 0]"),
            "scene.toml:1:13: the formula \"0.1*sni(x)\": there is no \"sni\" here; did you mean \"sin\"? "
            "The names are x, y, "
            "t, pi.");
  EXPECT_EQ(
      fault("velocity = [0, \"2*(x + 1\"]"),
      "scene.toml:1:16: the formula \"2*(x + 1\": a closing bracket is missing, at character 9; correct it.");
  EXPECT_EQ(fault("velocity = [0, \"2**x\"]"),
            "scene.toml:1:16: the formula \"2**x\": \"*\" can't stand there, at character 3; correct it.");
  EXPECT_EQ(fault("velocity = [0, \"x = 3\"]"),
            "scene.toml:1:16: the formula \"x = 3\": a formula assigns nothing; write == to compare.");
  EXPECT_EQ(fault("velocity = [0, \"x, y\"]"),
            "scene.toml:1:16: the formula \"x, y\": it gives 2 numbers, not one; take out the comma.");
  EXPECT_EQ(fault("velocity = [0, \"\"]"), "scene.toml:1:16: velocity[1] is empty; give a formula.");
  EXPECT_EQ(fault("velocity = [0, \"atan2(x)\"]"),
            "scene.toml:1:16: the formula \"atan2(x)\": the function \"atan2\" has too few arguments, at "
            "character 8; correct "
            "it.");
  EXPECT_EQ(fault("velocity = [0, \"2 m\"]").rfind("scene.toml:1:16: the formula \"2 m\"", 0), 0u)
      << fault("velocity = [0, \"2 m\"]");
  EXPECT_EQ(fault("velocity = [0, -200]"),
            "scene.toml:1:16: velocity[1] = -200 is below the allowed range (>= -100 m/s); give a value of "
            "at least -100.");
  EXPECT_EQ(fault("velocity = [0]"),
            "scene.toml:1:12: velocity must be a list of 2 numbers or formulas, not a list of 1.");
  EXPECT_EQ(fault("gradient = [1, 0, 0, 1]"),
            "scene.toml:1:12: gradient must be a list of 2 rows of 2 numbers or formulas, not a list of 4.");
  EXPECT_EQ(fault("define = {a = \"b\", b = \"2*a\"}\nvelocity = [\"a\", 0]"),
            "scene.toml:1:15: the definition of \"a\" needs itself (a -> b); break the circle.");
  EXPECT_EQ(fault("define = {sin = 1}"),
            "scene.toml:1:17: \"sin\" has a meaning in formulas already; take another name.");
  EXPECT_EQ(fault("define = {x-y = 1}"),
            "scene.toml:1:17: \"x-y\" can't be the name of a formula; take letters, digits and _, with a "
            "letter first.");
  // Also where nobody uses it.
  EXPECT_EQ(fault("define = {a = \"2*\"}"),
            "scene.toml:1:15: the formula \"2*\": it ends too early, at character 3; correct it.");
}

TEST(Formulas, EvaluationTakesNoMemory) {
  if (!test::HeapCounter::works) GTEST_SKIP();
  const Read r = read("velocity = [\"s*exp(-t) + min(x, y)\", \"atan2(y, x)\"]\n[define]\ns = \"x^2\"");
  at(r.velocity, 1, 2, 3);
  const std::size_t before = test::HeapCounter::live();
  test::HeapCounter::restart_peak();
  Real sum = 0;
  for (int i = 0; i < 100; ++i) sum += at(r.velocity, i, 1, 0).sum();
  EXPECT_TRUE(std::isfinite(sum));
  EXPECT_EQ(test::HeapCounter::peak(), before);
}

// The slope of a sine from the finest wave that a grid resolves, four cells long, to one of 10^5 cells, far from the origin
// too.
TEST(Formulas, GradientsToTenToTheMinusEight) {
  constexpr Real h = 0.1;
  for (const Real cells : {4.0, 10.0, 1e3, 1e5}) {
    const Real k = 2 * pi / (cells * h);
    Parameters p =
        Parameters::read_text(fmt::format("v = [\"sin({0:.17g}*x)\", \"cos({0:.17g}*y)\"]", k), "scene.toml");
    Formulas v;
    declare_formulas(p, "v", place_variables(2), 2, v, {});
    Real worst = 0;
    for (const Real place : {0.0, 0.37, 12.3, -45.6}) {
      const Vec<2> x(place, 1 - place);
      const Mat<2> g = gradient<2>(v, x, 0.01 * h);
      Mat<2> exact;
      exact << k * std::cos(k * x[0]), 0, 0, -k * std::sin(k * x[1]);
      worst = std::max(worst, (g - exact).norm() / k);
    }
    std::printf("wave of %g cells: relative error of the gradient %.2g (bound 1e-8)\n", cells, worst);
    EXPECT_LT(worst, 1e-8) << cells;
  }
}

}  // namespace
