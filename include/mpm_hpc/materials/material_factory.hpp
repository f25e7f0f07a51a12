// Makes a material from its table of the scene, and answers questions about a list of laws; a template on the
// list, so that a test can add a law of its own.
#pragma once

#include "mpm_hpc/base/parameters.hpp"
#include "mpm_hpc/materials/material_list.hpp"
#include "mpm_hpc/materials/material_loops.hpp"

namespace mpm {

template <int Dim, class Law>
constexpr bool law_has(MaterialAbility ability) {
  return ability == MaterialAbility::split_energy ? SplitsEnergy<Law, Dim> : HasTangent<Law, Dim>;
}

// "a", "b" for the laws of the list that have the ability; empty if none has.
template <int Dim, class... Laws>
std::string laws_with(LawList<Laws...>, MaterialAbility ability) {
  std::string names;
  const auto add = [&](const char* law) { names += fmt::format("{}\"{}\"", names.empty() ? "" : ", ", law); };
  ((law_has<Dim, Laws>(ability) ? add(Laws::name) : void()), ...);
  return names;
}

template <int Dim, class... Laws>
void require_ability_among(LawList<Laws...> laws, const Material<Dim>& material, MaterialAbility ability,
                           const std::string& wanted_by) {
  const bool split = ability == MaterialAbility::split_energy;
  if (split ? material.splits_energy() : material.has_tangent()) return;
  throw UserError(fmt::format(
      "{}: {} needs a material {}, which model = \"{}\" of material.{} lacks; models that "
      "have it: {}.",
      material.where(), wanted_by,
      split ? "whose energy splits into a part that drives cracks and the rest" : "with a tangent stiffness",
      material.model(), material.name(), laws_with<Dim>(laws, ability)));
}

template <int Dim, class... Laws>
std::unique_ptr<Material<Dim>> make_material_among(LawList<Laws...>, Parameters& parameters,
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

  std::unique_ptr<Material<Dim>> made;
  const auto declare = [&]<class Law>(Law law) {
    parameters.when("model", model, {Law::name}, [&] {
      law.declare(parameters);
      if (!parameters.describing()) made = std::make_unique<MaterialLoops<Law, Dim>>(common, law);
    });
  };
  (declare(Laws{}), ...);
  return made;
}

}  // namespace mpm
