#include "mpm_hpc/materials/material_update.hpp"

#include <algorithm>

#include "mpm_hpc/materials/material_factory.hpp"

namespace mpm {

void MaterialLimits::include(const MaterialLimits& other) {
  stiffness = std::max(stiffness, other.stiffness);
  wave_modulus = std::max(wave_modulus, other.wave_modulus);
  min_jacobian = std::min(min_jacobian, other.min_jacobian);
}

template <int Dim>
std::unique_ptr<Material<Dim>> make_material(Parameters& parameters, const std::string& name) {
  return make_material_among<Dim>(MaterialList<Dim>{}, parameters, name);
}

template <int Dim>
void require_ability(const Material<Dim>& material, MaterialAbility ability, const std::string& wanted_by) {
  require_ability_among<Dim>(MaterialList<Dim>{}, material, ability, wanted_by);
}

template std::unique_ptr<Material<2>> make_material<2>(Parameters&, const std::string&);
template std::unique_ptr<Material<3>> make_material<3>(Parameters&, const std::string&);
template void require_ability<2>(const Material<2>&, MaterialAbility, const std::string&);
template void require_ability<3>(const Material<3>&, MaterialAbility, const std::string&);

}  // namespace mpm
