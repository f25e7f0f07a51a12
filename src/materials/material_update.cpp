#include "mpm_hpc/materials/material_update.hpp"

#include <algorithm>

namespace mpm {

void MaterialLimits::include(const MaterialLimits& other) {
  stiffness = std::max(stiffness, other.stiffness);
  wave_modulus = std::max(wave_modulus, other.wave_modulus);
  min_jacobian = std::min(min_jacobian, other.min_jacobian);
  viscosity = std::max(viscosity, other.viscosity);
}

}  // namespace mpm
