// All laws and rules in 3D; one file per dimension, so that they are compiled side by side.
#include "mpm_hpc/materials/material_factory.hpp"

namespace mpm {

template <>
std::unique_ptr<Material<3>> make_material<3>(Parameters& parameters, const std::string& name) {
  return make_material_among<3>(MaterialList<3>{}, PlasticityList<3>{}, parameters, name);
}

template <>
void require_ability<3>(const Material<3>& material, MaterialAbility ability, const std::string& wanted_by) {
  require_ability_among<3>(MaterialList<3>{}, material, ability, wanted_by);
}

}  // namespace mpm
