// Numbers that a scene gives as functions of place and time.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/base/types.hpp"

namespace mpm {

// A list of components, each a number or an expression such as "0.1*sin(pi*x/50)" in given variables, pi, and what the
// scene's table [define] holds. Expressions are those of muParser: + - * / ^, comparisons, && ||, a ? b : c, sin, cos, tan,
// asin, acos, atan, atan2, sinh, cosh, tanh, exp, ln, log10, sqrt, abs, sign, min, max, ... All numbers are SI. It keeps the
// values of its variables, so that two threads must not share one.
class Formulas {
 public:
  using Definitions = std::vector<std::pair<std::string, FormulaText>>;

  Formulas();  // no component
  // Throws UserError, located in the scene and in the expression, for a name that is unknown or a fault of the syntax.
  Formulas(const std::vector<std::string>& variables, const std::vector<FormulaText>& components,
           const Definitions& definitions);
  Formulas(Formulas&&) noexcept;
  Formulas& operator=(Formulas&&) noexcept;
  ~Formulas();

  int size() const;
  // Whether no component depends on a variable.
  bool constant() const;
  bool uses(std::string_view variable) const;
  // The components for values of the variables in the order in which they were named; no allocation. What is not defined,
  // as 1/0, comes out as infinite or NaN.
  void evaluate(const Real* variables, Real* components) const;
  // The texts as the scene gives them, for messages.
  std::string text() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The table [define] of names that all formulas of the scene may use. UserError for names or expressions that can't be used.
void declare_definitions(Parameters& p);

// Reads a list (a matrix, with `row_length`) of numbers or formulas in these variables; `formulas` holds the number of
// components beforehand, which are 0 unless the scene gives the key. Returns whether it does.
bool declare_formulas(Parameters& p, std::string_view key, const std::vector<std::string>& variables,
                      int components, Formulas& formulas, const RealOptions& options, int row_length = 0);

// The first Dim of "x", "y", "z", or of "X", "Y", "Z".
std::vector<std::string> place_variables(int dimension, bool initial = false);

// d formulas[a] / d x_b at x, where the first Dim variables are the place and `step` is a length in which the formulas change
// little: the five-point central difference (Abramowitz and Stegun 25.3.6), whose error is f'''''/30 step^4.
template <int Dim>
Mat<Dim> gradient(const Formulas& formulas, const Vec<Dim>& x, Real step);

}  // namespace mpm
