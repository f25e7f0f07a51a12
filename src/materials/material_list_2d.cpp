// All laws and rules in 2D; one file per dimension, so that they are compiled side by side.
#include "mpm_hpc/materials/material_factory.hpp"

namespace mpm {

template <>
std::unique_ptr<Material<2>> make_material<2>(Parameters& parameters, const std::string& name) {
  return make_material_among<2>(MaterialList<2>{}, PlasticityList<2>{}, parameters, name);
}

template <>
void require_ability<2>(const Material<2>& material, MaterialAbility ability, const std::string& wanted_by) {
  require_ability_among<2>(MaterialList<2>{}, material, ability, wanted_by);
}

}  // namespace mpm
