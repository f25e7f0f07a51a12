#include "mpm_hpc/materials/fluid_constants.hpp"

#include "mpm_hpc/base/parameters.hpp"

namespace mpm {

void FluidConstants::declare(Parameters& parameters) {
  parameters.real(
      "bulk_modulus", bulk_modulus,
      {.unit = "Pa",
       .min = 0,
       .min_exclusive = true,
       .required = true,
       .doc = "bulk modulus at rest; K = density c^2 with c ten times the largest speed keeps the density "
              "within 1 %"});
  parameters.real("viscosity", viscosity, {.unit = "Pa s", .min = 0, .doc = "shear viscosity; 0: none"});
}

}  // namespace mpm
