// Makes a material from its table of the scene, and answers questions about lists of laws and rules; templates on the lists, so
// that a test can add one of its own.
#pragma once

#include <optional>
#include <variant>

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/material_list.hpp"
#include "mpm_hpc/materials/material_loops.hpp"
#include "mpm_hpc/materials/plasticity_list.hpp"

namespace mpm {

// A law that brings its plasticity with it.
template <class Law>
concept HasOwnPlasticity = requires { typename Law::Plasticity; };

// Whether the scene may join the rule to the law.
template <class Rule, class Law, int Dim>
constexpr bool can_join() {
  if constexpr (HasOwnPlasticity<Law> || FluidLaw<Law> || Relaxes<Law, Dim>) {
    return false;
  } else {
    return ReturnMapping<Rule, Law, Dim>;
  }
}

// "a", "b" for the laws of the list of which `holds` is true; empty if it is of none.
template <class... Laws, class Holds>
std::string laws_that(LawList<Laws...>, const Holds& holds) {
  std::string names;
  const auto add = [&](const char* law) { names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", law); };
  ((holds.template operator()<Laws>() ? add(Laws::name) : void()), ...);
  return names;
}

template <int Dim, class... Laws>
void require_ability_among(LawList<Laws...> laws, const Material<Dim>& material, MaterialAbility ability,
                           const std::string& wanted_by) {
  const bool split = ability == MaterialAbility::split_energy;
  if (split ? material.splits_energy() : material.has_tangent()) return;
  const auto has_it = [split]<class Law>() { return split ? SplitsEnergy<Law, Dim> : HasTangent<Law, Dim>; };
  throw UserError(fmt::format(
      "{}: {} needs a material {}, which model = \"{}\" of material.{} lacks; models that "
      "have it: {}.",
      material.where(), wanted_by,
      split ? "whose energy splits into a part that drives cracks and the rest" : "with a tangent stiffness",
      material.model(), material.name(), laws_that(laws, has_it)));
}

// A plasticity rule of the scene with its place there.
template <class... Rules>
struct ChosenRule {
  std::variant<Elastic, Rules...> rule;
  std::string where;
};

// Reads [material.NAME.plasticity]; Elastic if there is none.
template <class... Rules>
ChosenRule<Rules...> read_plasticity(RuleList<Rules...>, Parameters& parameters) {
  ChosenRule<Rules...> chosen;
  if (!parameters.has("plasticity")) return chosen;
  parameters.section("plasticity", SectionOptions("plasticity; without it the material is elastic"), [&](Parameters& q) {
    std::string model, doc = "rule that returns stresses to a yield surface";
    ((doc += fmt::format("; {}: {}", Rules::name, Rules::doc)), ...);
    q.choice("model", model, {Rules::name...}, {.required = true, .doc = doc});
    chosen.where = q.where("model");
    const auto declare = [&]<class Rule>(Rule rule) {
      q.when("model", model, {Rule::name}, [&] {
        rule.declare(q);
        chosen.rule = rule;
      });
    };
    (declare(Rules{}), ...);
  });
  return chosen;
}

template <int Dim, class... Laws, class... Rules>
std::unique_ptr<Material<Dim>> make_material_among(LawList<Laws...> laws, RuleList<Rules...> rules, Parameters& parameters,
                                                   const std::string& name) {
  typename Material<Dim>::Common common;
  common.name = name;
  common.where = parameters.where("model");

  std::string model, doc = "material law";
  ((doc += fmt::format("; {}: {}", Laws::name, Laws::doc)), ...);
  parameters.choice("model", model, {Laws::name...}, {.required = true, .doc = doc});
  parameters.real("density", common.density,
                  {.unit = "kg/m^3",
                   .min = 0,
                   .min_exclusive = true,
                   .required = true,
                   .doc = "mass per volume at rest"});
  std::optional<Real> toughness;
  parameters.optional_real("fracture_toughness", toughness,
                           {.unit = "J/m^2",
                            .min = 0,
                            .min_exclusive = true,
                            .doc = "energy per crack surface; without it the material can't fracture"});
  common.fracture_toughness = toughness.value_or(-1);
  const ChosenRule<Rules...> plasticity = read_plasticity(rules, parameters);

  std::unique_ptr<Material<Dim>> made;
  const auto join = [&]<class Law, class Rule>(const Law& law, const Rule& rule) {
    if constexpr (std::is_same_v<Rule, Elastic> || can_join<Rule, Law, Dim>()) {
      made = std::make_unique<MaterialLoops<Law, Dim, Rule>>(common, law, rule);
    } else {
      throw UserError(fmt::format(
          "{}: plasticity \"{}\" of material.{} can't be joined to model = \"{}\"{}; models that can carry it: {}.",
          plasticity.where, Rule::name, name, Law::name,
          HasOwnPlasticity<Law> ? ", which has its own" : "",
          laws_that(laws, []<class Other>() { return can_join<Rule, Other, Dim>(); })));
    }
  };
  const auto declare = [&]<class Law>(Law law) {
    parameters.when("model", model, {Law::name}, [&] {
      law.declare(parameters);
      if constexpr (HasOwnPlasticity<Law>) {
        typename Law::Plasticity own;
        own.declare(parameters);
        if (parameters.describing()) return;
        if (std::holds_alternative<Elastic>(plasticity.rule)) {
          made = std::make_unique<MaterialLoops<Law, Dim, typename Law::Plasticity>>(common, law, own);
          return;
        }
      }
      if (!parameters.describing()) std::visit([&](const auto& rule) { join(law, rule); }, plasticity.rule);
    });
  };
  (declare(Laws{}), ...);
  return made;
}

}  // namespace mpm
