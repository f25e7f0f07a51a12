// What every fluid is read from: bulk modulus and viscosity.
#pragma once

#include "mpm_hpc/base/types.hpp"

namespace mpm {

class Parameters;

struct FluidConstants {
  Real bulk_modulus = 0;  // K [Pa]
  Real viscosity = 0;     // eta, of shear [Pa s]

  void declare(Parameters& parameters);
};

}  // namespace mpm
