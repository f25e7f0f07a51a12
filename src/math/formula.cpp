#include "mpm_hpc/math/formula.hpp"

#include <fmt/ranges.h>
#include <muParser.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "mpm_hpc/base/error.hpp"
#include "mpm_hpc/base/text.hpp"

namespace mpm {

namespace {

const std::vector<std::string> all_variables = {"x", "y", "z", "t", "X", "Y", "Z"};

std::vector<std::string> function_names() {
  std::vector<std::string> names;
  const mu::Parser parser;
  for (const auto& entry : parser.GetFunDef()) names.push_back(entry.first);
  return names;
}

// "=" that assigns: muParser would let an expression overwrite its variables.
bool assigns(const std::string& text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] != '=') continue;
    if (i + 1 < text.size() && text[i + 1] == '=') {
      ++i;
    } else if (i == 0 || std::string_view("<>!").find(text[i - 1]) == std::string_view::npos) {
      return true;
    }
  }
  return false;
}

// What muParser found, without the token and place that it writes into its sentences.
std::string reason(const mu::ParserError& error) {
  const std::string token = error.GetToken();
  switch (error.GetCode()) {
    case mu::ecUNEXPECTED_EOF:
      return "it ends too early";
    case mu::ecMISSING_PARENS:
      return "a closing bracket is missing";
    case mu::ecUNEXPECTED_PARENS:
      return "a bracket stands where none can";
    case mu::ecTOO_MANY_PARAMS:
      return fmt::format("the function \"{}\" has too many arguments", token);
    case mu::ecTOO_FEW_PARAMS:
      return fmt::format("the function \"{}\" has too few arguments", token);
    case mu::ecEMPTY_EXPRESSION:
      return "it is empty";
    case mu::ecUNASSIGNABLE_TOKEN:
      return fmt::format("\"{}\" can't be read", token);
    default:
      return token.empty() ? std::string("it can't be read") : fmt::format("\"{}\" can't stand there", token);
  }
}

}  // namespace

struct Formulas::Impl {
  struct Expression {
    std::unique_ptr<mu::Parser> parser;  // a copy would parse anew
    Real* result;
  };
  // What an unknown name makes of the parser.
  struct UnknownName {
    std::string name;
  };

  std::vector<std::string> names;       // of the variables
  std::vector<Real> values;             // of the variables; addresses stay
  std::map<std::string, Real> defined;  // values of the definitions in use; addresses stay
  std::vector<std::string> used;        // variables
  std::vector<Expression> definitions;  // that vary, in the order of evaluation
  std::vector<Expression> expressions;  // of the components that vary
  std::vector<Real> components;
  std::vector<std::string> texts;
  const Definitions* known = nullptr;  // while it is compiled
  std::vector<std::string> under_way;  // definitions that are being compiled
  std::set<std::string> varying;       // definitions
  bool varies = false;                 // whether what is being compiled has met a variable

  static Real* find_name(const char* name, void* self) { return static_cast<Impl*>(self)->find(name); }

  Real* find(const std::string& name) {
    if (const auto variable = std::find(names.begin(), names.end(), name); variable != names.end()) {
      if (std::find(used.begin(), used.end(), name) == used.end()) used.push_back(name);
      varies = true;
      return &values[static_cast<std::size_t>(variable - names.begin())];
    }
    if (const auto done = defined.find(name);
        done != defined.end() && std::find(under_way.begin(), under_way.end(), name) == under_way.end()) {
      varies = varies || varying.contains(name);
      return &done->second;
    }
    const auto definition = std::find_if(known->begin(), known->end(),
                                         [&name](const auto& entry) { return entry.first == name; });
    if (definition == known->end()) throw UnknownName{name};
    require(std::find(under_way.begin(), under_way.end(), name) == under_way.end(),
            "{}: the definition of \"{}\" needs itself ({}); break the circle.", definition->second.where,
            name, fmt::join(under_way, " -> "));
    Real& result = defined[name] = definition->second.number;
    if (!definition->second.text.empty()) {
      under_way.push_back(name);
      if (compile(definition->second, &result, definitions)) varying.insert(name);
      under_way.pop_back();
    }
    return &result;
  }

  // Adds an expression to the list if it varies, and returns whether it does; else its value is found once and for all.
  bool compile(const FormulaText& formula, Real* result, std::vector<Expression>& list) {
    const bool outer = std::exchange(varies, false);
    Expression expression = compiled(formula, result);
    const bool varied = varies;
    if (varied) {
      list.push_back(std::move(expression));
    } else {
      *result = expression.parser->Eval();
    }
    varies = varied || outer;
    return varied;
  }

  Expression compiled(const FormulaText& formula, Real* result) {
    Expression expression{std::make_unique<mu::Parser>(), result};
    mu::Parser& parser = *expression.parser;
    const std::string at = fmt::format("{}: the formula \"{}\": ", formula.where, formula.text);
    require(!assigns(formula.text), "{}a formula assigns nothing; write == to compare.", at);
    try {
      parser.DefineConst("pi", std::numbers::pi);
      parser.SetVarFactory(find_name, this);
      parser.SetExpr(formula.text);
      parser.Eval();
    } catch (const UnknownName& unknown) {
      std::vector<std::string> candidates = names;
      candidates.push_back("pi");
      for (const auto& entry : *known) candidates.push_back(entry.first);
      const std::string listed = fmt::format("{}", fmt::join(candidates, ", "));
      for (const std::string& function : function_names()) candidates.push_back(function);
      // Every single letter is near to x.
      const std::string near =
          unknown.name.size() > 1 ? nearest_word(unknown.name, candidates) : std::string();
      throw UserError(fmt::format("{}there is no \"{}\" here; {}.", at, unknown.name,
                                  near.empty()
                                      ? "the names are " + listed + " and functions such as sin"
                                      : fmt::format("did you mean \"{}\"? The names are {}", near, listed)));
    } catch (const mu::ParserError& error) {
      const int place = std::clamp(error.GetPos(), 0, static_cast<int>(formula.text.size()));
      throw UserError(fmt::format("{}{}, at character {}; correct it.", at, reason(error), place + 1));
    }
    require(parser.GetNumResults() == 1, "{}it gives {} numbers, not one; take out the comma.", at,
            parser.GetNumResults());
    return expression;
  }
};

Formulas::Formulas() : impl_(std::make_unique<Impl>()) {}
Formulas::Formulas(Formulas&&) noexcept = default;
Formulas& Formulas::operator=(Formulas&&) noexcept = default;
Formulas::~Formulas() = default;

Formulas::Formulas(const std::vector<std::string>& variables, const std::vector<FormulaText>& components,
                   const Definitions& definitions)
    : Formulas() {
  impl_->names = variables;
  impl_->values.assign(variables.size(), 0);
  impl_->known = &definitions;
  impl_->components.resize(components.size());
  for (std::size_t c = 0; c < components.size(); ++c) {
    impl_->components[c] = components[c].number;
    impl_->texts.push_back(components[c].text.empty() ? fmt::format("{:.6g}", components[c].number)
                                                      : components[c].text);
    if (!components[c].text.empty()) impl_->compile(components[c], &impl_->components[c], impl_->expressions);
  }
  impl_->known = nullptr;
}

int Formulas::size() const { return static_cast<int>(impl_->components.size()); }

bool Formulas::constant() const { return impl_->used.empty(); }

bool Formulas::uses(std::string_view variable) const {
  return std::find(impl_->used.begin(), impl_->used.end(), variable) != impl_->used.end();
}

void Formulas::evaluate(const Real* variables, Real* components) const {
  std::copy_n(variables, impl_->values.size(), impl_->values.begin());
  for (const Impl::Expression& e : impl_->definitions) *e.result = e.parser->Eval();
  for (const Impl::Expression& e : impl_->expressions) *e.result = e.parser->Eval();
  std::copy(impl_->components.begin(), impl_->components.end(), components);
}

std::string Formulas::text() const { return fmt::format("[{}]", fmt::join(impl_->texts, ", ")); }

void declare_definitions(Parameters& p) {
  p.define_formulas(
      "define",
      "Names that formulas may use: numbers, or formulas in x, y, z, t, X, Y, Z and other names. Formulas "
      "are in SI.");
  const Formulas::Definitions& definitions = p.definitions();
  std::vector<std::string> taken = all_variables;
  taken.push_back("pi");
  for (const std::string& function : function_names()) taken.push_back(function);
  for (const auto& [name, formula] : definitions) {
    const bool valid =
        (std::isalpha(static_cast<unsigned char>(name[0])) || name[0] == '_') &&
        std::all_of(name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) || c == '_'; });
    require(valid,
            "{}: \"{}\" can't be the name of a formula; take letters, digits and _, with a letter first.",
            formula.where, name);
    require(std::find(taken.begin(), taken.end(), name) == taken.end(),
            "{}: \"{}\" has a meaning in formulas already; take another name.", formula.where, name);
    Formulas(all_variables, {{0, name, formula.where}},
             definitions);  // so that faults show also if nobody uses it
  }
}

bool declare_formulas(Parameters& p, std::string_view key, const std::vector<std::string>& variables,
                      int components, Formulas& formulas, const RealOptions& options, int row_length) {
  std::vector<FormulaText> texts(static_cast<std::size_t>(components));
  const bool given = p.formulas(key, texts, options, row_length);
  formulas = Formulas(variables, texts, p.definitions());
  return given;
}

std::vector<std::string> place_variables(int dimension, bool initial) {
  const std::vector<std::string> names = {"x", "y", "z"}, initial_names = {"X", "Y", "Z"};
  const auto& chosen = initial ? initial_names : names;
  return {chosen.begin(), chosen.begin() + dimension};
}

template <int Dim>
Mat<Dim> gradient(const Formulas& formulas, const Vec<Dim>& x, Real step) {
  Mat<Dim> result = Mat<Dim>::Zero();
  if (formulas.constant()) return result;
  for (int b = 0; b < Dim; ++b) {
    // f(x + n step) and its exact abscissa: x + step may round.
    auto at = [&](int n, Vec<Dim>& place) {
      place = x;
      place[b] += n * step;
      Vec<Dim> value;
      formulas.evaluate(place.data(), value.data());
      return value;
    };
    Vec<Dim> low, high;
    const Vec<Dim> near = at(1, high) - at(-1, low);
    const Vec<Dim> near_slope = near / (high[b] - low[b]);
    const Vec<Dim> far = at(2, high) - at(-2, low);
    const Vec<Dim> far_slope = far / (high[b] - low[b]);
    result.col(b) = (4 * near_slope - far_slope) / 3;
  }
  return result;
}

template Mat<2> gradient<2>(const Formulas&, const Vec<2>&, Real);
template Mat<3> gradient<3>(const Formulas&, const Vec<3>&, Real);

}  // namespace mpm
